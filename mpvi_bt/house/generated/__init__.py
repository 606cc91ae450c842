"""Houses drawn by a seed: rooms, doorways and furniture by rules, as the text of a house's file; no simulator."""
