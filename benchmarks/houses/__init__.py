"""Generated houses: whether they are valid, how long one takes, and how they look."""
