"""The house: a physical world in which tasks are played and scored. It stands in for a home."""
