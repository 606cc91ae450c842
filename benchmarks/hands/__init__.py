"""Trials of single skills, in small rooms: `python -m benchmarks.hands --help`."""
