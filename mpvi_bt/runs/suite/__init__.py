"""Many episodes: which, where they run, what is kept of them."""
