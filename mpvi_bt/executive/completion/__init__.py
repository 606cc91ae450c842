"""Completion checkers: when they are asked, and what they answer."""
