"""Hands that were learned: a policy of points and proprioception, its demonstrations and its training."""
