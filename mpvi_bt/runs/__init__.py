"""Runs: what an episode is made of, its result, and many of them."""
