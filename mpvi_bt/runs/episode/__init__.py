"""One episode: what it is told, its parts put together, its result."""
