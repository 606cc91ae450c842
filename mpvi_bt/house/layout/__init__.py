"""Houses: rooms, fixtures and places to put things, from YAML; no simulator."""
