"""Files of a user: what is wrong with them, and new ones to begin with."""
