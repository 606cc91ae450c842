"""The physical world in SAPIEN: the robot, cameras, contact, states of things."""
