"""One file a skill, and what several skills share."""
