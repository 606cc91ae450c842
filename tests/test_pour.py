"""Pouring: lips of vessels, vessels righted, and that what was inside really ends up where it is poured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Solid
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills import pour
from mpvi_bt.hands.skills.pour import lip, righted
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing import SceneBuilder

angles = st.floats(-3.1, 3.1)


@given(
    angles,
    angles,
    st.floats(0.02, 0.1),
    st.floats(0.02, 0.1),
    st.floats(0.02, 0.1),
    st.sampled_from(["box", "cylinder"]),
)
def test_a_lip_is_on_the_rim_toward_where_it_is_poured(
    yaw: float, at: float, x: float, y: float, z: float, kind: str
) -> None:
    """It is as high as the opening, on its edge, and no point of a round rim lies farther that way."""
    half = np.array([x, x if kind == "cylinder" else y, z])
    volume = Solid(kind, half, kin.transform(np.eye(3), (0.01, -0.02, 0.03)))  # type: ignore[arg-type]
    R, out = kin.rot_z(yaw), np.array([np.cos(at), np.sin(at), 0.0])
    off = R @ (lip(volume, R, out) - volume.T[:3, 3])
    assert off[2] == pytest.approx(z)
    assert off[:2] @ out[:2] == pytest.approx(np.linalg.norm(off[:2]), abs=1e-6)
    local = np.abs(R.T @ off)[:2] / half[:2]
    assert (np.linalg.norm(local) if kind == "cylinder" else local.max()) == pytest.approx(1.0)


@given(st.integers(0, 10_000))
def test_a_vessel_is_righted_by_the_least_turn(seed: int) -> None:
    """Its opening looks up afterwards, wherever it looked before, and nothing has turned about the vertical."""
    T = kin.transform(np.asarray(Rotation.random(random_state=seed).as_matrix()), (0.1, 0.2, 0.3))
    axis = T[:3, 2]
    assume(axis[2] > -0.99)
    up = righted(T, axis)
    np.testing.assert_allclose(up[:3, 2], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(up[:3, 3], T[:3, 3])
    turn = up[:3, :3] @ T[:3, :3].T
    assert np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) == pytest.approx(float(np.arccos(axis[2])), abs=1e-6)


def test_looking_for_a_level_way_ends_when_nothing_is_left_to_spend(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no way keeps the vessel level, each one looked for counts as much as the place to stand that it needs."""
    world = (
        SceneBuilder()
        .thing("cup", "coffee_cup")
        .in_hand("right", "cup")
        .thing("egg", "easter_egg")
        .inside("cup", "egg")
        .thing("bowl", "mixing_bowl", at=(0.9, 0.0, 0.001))
        .world()
    )
    call = match("pour the Easter egg out of the coffee cup into the mixing bowl", load_skills())
    assert call is not None
    looked: list[float] = []
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0), effort=Effort(5.0))

    def no_way(*_: object) -> None:
        looked.append(work.effort.left)

    monkeypatch.setattr(pour, "_course", no_way)
    next(pour.pour(work, call.arguments, []))
    assert looked == [3.0, 1.0, -1.0]
