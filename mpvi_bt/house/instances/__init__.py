"""Tasks, and where the things and the robot begin in each instance."""
