"""Words for things: phrases, and the names that people use."""
