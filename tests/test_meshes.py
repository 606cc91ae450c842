"""Meshes of solids are closed, and look outwards."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.ground.geometry.solids import Solid, pose
from mpvi_bt.house.things.description import Part
from mpvi_bt.house.things.meshes import meshes

Kind = Literal["box", "cylinder", "sphere"]
VOLUME = {"box": 8.0, "cylinder": 2 * np.pi, "sphere": 4 / 3 * np.pi}


@given(
    kind=st.sampled_from(["box", "cylinder", "sphere"]),
    half=st.tuples(*[st.floats(0.01, 2)] * 3),
    center=st.tuples(*[st.floats(-3, 3)] * 3),
    yaw=st.floats(-3, 3),
)
def test_a_mesh_encloses_its_solid(
    kind: Kind, half: tuple[float, float, float], center: tuple[float, float, float], yaw: float
) -> None:
    """By the divergence theorem a mesh holds its solid's volume, less what facets cut off; normals look outwards."""
    a, b, c = half
    sizes = {"box": (a, b, c), "cylinder": (a, a, c), "sphere": (a, a, a)}[kind]
    solid = Solid(kind, np.array(sizes), pose(center, yaw))
    ((_, mesh),) = meshes([Part(solid, (1.0, 0.0, 0.0))])
    corners = mesh.vertices[mesh.triangles] - np.array(center)
    volume = np.linalg.det(corners).sum() / 6
    exact = VOLUME[kind] * np.prod(sizes)
    assert 0.93 * exact <= volume <= 1.0001 * exact
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all((facing * mesh.normals[mesh.triangles].sum(1)).sum(1) >= -1e-12)


def test_one_mesh_a_color() -> None:
    """Parts of one color become one mesh."""
    ball = Solid("sphere", np.full(3, 0.1))
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    found = dict(meshes([Part(ball, red), Part(ball, blue), Part(ball, red)]))
    assert len(found[red].triangles) == pytest.approx(2 * len(found[blue].triangles))
