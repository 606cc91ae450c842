"""Eyes that were learned: a network that cuts pictures into segments, its pictures and its training."""
