"""What moves the hands."""
