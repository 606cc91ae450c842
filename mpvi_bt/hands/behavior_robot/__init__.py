"""BEHAVIOR's R1Pro over the wire: its evaluators' dialects, its numbers, and another robot's joints as its own."""
