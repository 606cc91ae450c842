"""From pictures to named things and their places."""
