"""Live pages of runs and suites, and the server for them."""
