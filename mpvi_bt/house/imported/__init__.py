"""Houses of others, as the text of a house's file."""
