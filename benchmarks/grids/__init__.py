"""Searches, looks and frontiers on grids, ours beside libraries: `python -m benchmarks.grids --help`."""
