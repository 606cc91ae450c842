"""Disturbances of real robots that a simulation lacks: late answers and failing policies."""
