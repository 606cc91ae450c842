"""The bridge to a robot over ROS 2: its topics in a file, what they say, and what may be commanded when."""
