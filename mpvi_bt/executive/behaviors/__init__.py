"""The nodes of trees, on the simulation clock; they know protocols and no backend."""
