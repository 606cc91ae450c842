"""Policies that move the hands: scripted ones by truth or by sight."""
