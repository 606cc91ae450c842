"""What a robot is, and the bimanual r1 model."""
