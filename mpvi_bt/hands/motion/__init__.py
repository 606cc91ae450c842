"""Motions that skills are made of: approach, carry, follow a course, look."""
