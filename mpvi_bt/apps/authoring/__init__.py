"""Files of a user: what is wrong with them, new ones to begin with, and what a robot is like."""
