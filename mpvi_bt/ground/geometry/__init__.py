"""Geometry in space: solids, rotations, rays, and compiled loops over them."""
