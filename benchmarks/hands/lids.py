"""Scenes of opening and closing movable things with a lid, which stand on a table."""

from __future__ import annotations

import numpy as np

from benchmarks.hands.doors import positions
from benchmarks.hands.rooms import arrival, catalogue, placed
from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.testing.scene_builder import HALF_M, one_room

_MOST_MOVED_M = 0.15
_ASKEW_RAD = 0.25  # how far its front may look past whoever stands there


def lid(entry_name: str, said: str, opened: bool) -> Scene:
    """Scenes of opening what is closed, or of closing what stands open if it is `opened`.

    Codes: closed or open (nothing has moved), ajar (not far enough), moved (it stands 15 cm away), toppled.
    """

    def scene(rng: np.random.Generator, shapes: Shapes) -> Trial:
        y = float(round(rng.uniform(-0.5, 0.5), 3))
        height = float(round(rng.uniform(0.5, 0.88), 3))
        size = [0.65, 1.3, height]
        table = {"entry": "workbench", "at": [HALF_M - 0.4, y], "yaw_deg": 180, "shape": {"size_m": size}}
        entry = catalogue()[entry_name]
        low, high = (0.95, 1.05) if shapes == "tuning" else (0.88, 0.95)
        entry = entry.reshaped({"size_m": [round(s * float(rng.uniform(low, high)), 3) for s in entry.shape["size_m"]]})
        depth = float(entry.description.extent()[1, 0])
        x = HALF_M - 0.725 + depth + float(rng.uniform(0.04, 0.16))
        things = {"thing_1": placed(entry, x, y, height, np.pi + float(rng.uniform(-_ASKEW_RAD, _ASKEW_RAD)))}
        house = one_room({"table_1": table})
        start = {"thing_1": {"lid": float(rng.uniform(0.5, 0.85))}} if opened else {}

        def done(world: SimWorld) -> str:
            T = world.pose("thing_1")
            if T[2, 2] < 0.9:
                return "toppled"
            if np.linalg.norm(T[:2, 3] - [x, y]) > _MOST_MOVED_M:
                return "moved"
            ((_, clearly, shut),) = positions(world, "thing_1").values()
            if opened:
                return "" if shut else "open" if clearly else "ajar"
            return "" if clearly else "closed" if shut else "ajar"

        before = np.array([HALF_M - 0.8, y])
        prompt = f"{'close' if opened else 'open'} the {said}"
        return Trial(house, things, arrival(before, rng, house, things, {}), prompt, done, opened=start)

    return scene


_LIDDED = {"toolbox": "toolbox", "hinged_jar": "jar", "laptop": "laptop"}
SKILLS: dict[str, dict[str, Scene]] = {
    "open": {said: lid(entry, said, False) for entry, said in _LIDDED.items() if said != "laptop"},
    "close": {said: lid(entry, said, True) for entry, said in _LIDDED.items()},
}
