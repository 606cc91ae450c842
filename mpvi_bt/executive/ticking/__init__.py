"""The loop that ticks, and what steers it: replanning, the debugger, stopping and resuming."""
