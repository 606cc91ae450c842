"""Grains: diced food, popcorn or the like, many small bodies that vessels hold.

Source: OmniGibson, object_states/contains.py and filled.py.
"""

from __future__ import annotations

FILLED = 0.2  # of a vessel's volume, each grain counted as the cube about it


def contains(grains: int) -> bool:
    """Whether a vessel holds any of a kind: one of so many grains is enough."""
    return grains > 0


def share(grains: int, radius_m: float, volume_m3: float) -> float:
    """How much of a vessel's volume grains of a radius take, each as the cube about it."""
    return grains * (2 * radius_m) ** 3 / volume_m3


def filled(grains: int, radius_m: float, volume_m3: float) -> bool:
    """Whether a vessel is filled with a kind."""
    return share(grains, radius_m, volume_m3) > FILLED
