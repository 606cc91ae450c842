"""Hands that work: the robots that ship, and the policies that move them. They stand in for a VLA."""
