"""Searches for things whose place is unknown, over the whole house."""
