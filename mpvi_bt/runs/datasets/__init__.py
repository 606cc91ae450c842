"""LeRobot datasets, made of recorded demonstrations."""
