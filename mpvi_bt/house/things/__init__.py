"""The catalogue: what things are made of; no simulator."""
