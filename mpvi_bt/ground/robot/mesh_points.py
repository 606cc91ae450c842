"""The points of a robot's meshes, for its footprint and picture: of STL and OBJ, which need no library."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mpvi_bt.ground.geometry.solids import Array

_MAX_BYTES = 64 << 20  # our choice: larger meshes are not drawn
_HEADER, _TRIANGLE = 84, 50  # of a binary STL [bytes]
_NUMBER = rb"\s+([-+.\deE]+)"
_VERTICES = {".stl": re.compile(rb"^\s*vertex" + _NUMBER * 3, re.M), ".obj": re.compile(rb"^v" + _NUMBER * 3, re.M)}


def mesh_points(file: Path) -> Array:
    """(n, 3) the corners of a mesh's triangles, in its unit; none of other formats, and of what cannot be read."""
    suffix = file.suffix.lower()
    try:
        if suffix not in _VERTICES or file.stat().st_size > _MAX_BYTES:
            return np.zeros((0, 3))
        data = file.read_bytes()
        if suffix == ".stl" and len(data) >= _HEADER:
            count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
            if len(data) == _HEADER + _TRIANGLE * count:
                rows = np.frombuffer(data, np.uint8, offset=_HEADER).reshape(count, _TRIANGLE)
                corners = np.ascontiguousarray(rows[:, 12:48]).view("<f4").reshape(-1, 3).astype(float)
                return corners[np.isfinite(corners).all(1)]
        points = np.array([[float(x) for x in found] for found in _VERTICES[suffix].findall(data)])
    except (OSError, ValueError):
        return np.zeros((0, 3))
    return points.reshape(-1, 3)
