"""What a robot is, how it moves, and the robots that there are."""
