"""Simulator truth as a scene, and the expert that works on it."""
