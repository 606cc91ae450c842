"""Reading and explaining traces, and comparing two."""
