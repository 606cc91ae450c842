"""Where things are and how to drive to them: for any base with a depth camera."""
