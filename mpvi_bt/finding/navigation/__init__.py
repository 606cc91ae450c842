"""Driving to what a phrase names: maps, ways, search."""
