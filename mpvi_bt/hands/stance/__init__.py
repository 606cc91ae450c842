"""Where to stand for a piece of work, and in which posture."""
