"""The executive: an instruction becomes a plan, a tree, and ticks. It knows no robot and no world."""
