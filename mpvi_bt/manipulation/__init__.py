"""Policies that move the hands, and what a scripted one is made of."""
