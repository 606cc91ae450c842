"""Pictures to what is where."""
