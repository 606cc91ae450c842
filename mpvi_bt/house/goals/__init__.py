"""BDDL: problems, and whether a goal holds in a world."""
