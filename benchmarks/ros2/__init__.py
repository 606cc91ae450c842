"""Our executive over ROS 2: whole episodes in the house, and robots and bridges that fail."""
