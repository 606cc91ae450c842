"""Updates the maps and the known things with pictures of the head camera while the base drives."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.discovery import Discoveries
from mpvi_bt.finding.scene.occupancy import Occupancy
from mpvi_bt.finding.scene.visibility import VisibilityMap
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Clock
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Robot

Circle = tuple[float, float, float]  # x, y, radius [m] in the world

EVERY_S = 0.3  # Our choice: a turn of 1.2 rad/s passes a quarter of the field of view meanwhile
CLOSER_M = 2.0  # Our choice: a tennis ball has twenty pixels there
_ON_FLOOR_M = 0.15  # Our choice: what begins lower stood on the floor, and taking it up clears the floor
_MOVED_M, _TURNED_RAD = 0.03, 0.03  # Our choice: a view that differs by less shows nothing new


class CameraMapper:
    """Takes a picture with the head camera every so often and hands it to the maps and to the knowledge base.

    (Paper, Navigation appendix: detection of all task-relevant objects runs throughout, and what is found is kept.)

    Attributes:
        visibility: What was seen, from afar or near.
        closer: What was seen from near by, as small things have to be.
        pictures: Taken so far.
        looked_s: When the last one was, in simulated time.
        last: The last one, for pictures of the run; None before the first.
    """

    def __init__(
        self,
        robot: Robot,
        clock: Clock,
        occupancy: Occupancy,
        visibility: VisibilityMap,
        discoveries: Discoveries,
        takes_up: Callable[[], Sequence[Circle]],
        every_s: float = EVERY_S,
    ) -> None:
        """Bind the parts; nothing is looked at before `step`.

        Args:
            robot: Whose head camera looks.
            clock: Simulated time.
            occupancy, visibility, discoveries: Which learn.
            takes_up: The circles of floor that the robot and what it carries stand over now: no obstacles.
            every_s: Simulated time between two pictures.
        """
        self._robot, self._clock = robot, clock
        self.occupancy, self.visibility, self.discoveries = occupancy, visibility, discoveries
        self.closer = VisibilityMap(occupancy.map, CLOSER_M)
        self._takes_up, self._every = takes_up, max(1, round(every_s * CONTROL_HZ))
        self._looked = -(10**9)
        self._pose: Array | None = None
        self.pictures = 0
        self.looked_s = -1.0
        self.last: CameraImage | None = None

    @property
    def solid(self) -> NDArray[np.bool_]:
        """(H, W) what is known to stand somewhere: sight ends there."""
        solid: NDArray[np.bool_] = self.occupancy.map.occupied & self.occupancy.known
        return solid

    def step(self) -> None:
        """Look if it is time to, and if the view is another one; once a control step while navigating."""
        if self._clock.steps - self._looked < self._every:
            return
        pose = self._robot.proprioception().base_pose
        if self._pose is not None and _same(self._pose, pose):
            return
        self.look()

    def look(self) -> None:
        """Look now."""
        body = self._robot.proprioception()
        self._looked, self._pose = self._clock.steps, body.base_pose
        image = self._robot.look("head")
        self.pictures, self.last, self.looked_s = self.pictures + 1, image, self._clock.time_s
        self.occupancy.update(image, self._takes_up())
        solid = self.solid
        for view in (self.visibility, self.closer):
            view.update(image, solid)
        self.discoveries.see(image, body)

    def feel(self) -> None:
        """Update payloads by touch, and clear the floor where a thing was picked up."""
        for lowest, highest in self.discoveries.feel(self._robot.proprioception()):
            if lowest[2] < _ON_FLOOR_M:
                self.occupancy.clear(lowest, highest)

    def expect(self, name: str) -> None:
        """Doubt the entry of this name if the last picture, which was taken of its place, does not show it."""
        if self.last is not None:
            self.discoveries.expect(name, self.last)

    def save(self) -> dict[str, Any]:
        """What was learned so far, as JSON values."""
        maps = {name: _packed(cells) for name, cells in self._maps().items()}
        return {"discoveries": self.discoveries.save(), "pictures": self.pictures, **maps}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring this to what was saved.

        Raises:
            KeyError, TypeError, ValueError: What was saved is not as `save` writes it, or is of another map.
        """
        maps = {name: _unpacked(saved[name], was) for name, was in self._maps().items()}
        pictures = int(saved["pictures"])
        self.discoveries.restore(saved["discoveries"])
        self.occupancy.restore(maps)
        self.visibility.seen, self.closer.seen, self.pictures = maps["seen"], maps["closer"], pictures

    def _maps(self) -> dict[str, NDArray[Any]]:
        """What was learned of each cell: arrays (H, W), bool or bytes."""
        return {**self.occupancy.save(), "seen": self.visibility.seen, "closer": self.closer.seen}


def _packed(cells: NDArray[Any]) -> str:
    """An array of bool or bytes as text; a mask is a bit a cell before it is compressed."""
    data = np.packbits(cells) if cells.dtype == bool else cells
    return base64.b64encode(zlib.compress(data.tobytes())).decode()


def _unpacked(text: str, like: NDArray[Any]) -> NDArray[Any]:
    """The array of a text, of the shape and type of another one. Raises ValueError if it is of another size."""
    size = -(-like.size // 8) if like.dtype == bool else like.size
    try:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(base64.b64decode(text, validate=True), size + 1)
    except zlib.error as error:
        raise ValueError(f"no cells of a map: {error}") from None
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes of cells where a map has {size}")
    cells = np.frombuffer(data, np.uint8)
    flat = np.unpackbits(cells, count=like.size) if like.dtype == bool else cells
    return flat.astype(like.dtype).reshape(like.shape)


def _same(before: Array, now: Array) -> bool:
    near = float(norm(now[:2] - before[:2])) < _MOVED_M
    return near and abs(float(wrap(now[2] - before[2]))) < _TURNED_RAD
