"""The frames that tf told of: where one is in another."""

from __future__ import annotations

from typing import Any

import numpy as np

from mpvi_bt.ground.errors import BadMessage, did_you_mean, nearest
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.ros2.state_messages import stamp_of


class TransformTree:
    """The last transform of each frame to its parent.

    Args:
        file: The bridge file, for messages.
    """

    def __init__(self, file: str) -> None:
        self._file = file
        self._parents: dict[str, tuple[str, Array, int]] = {}

    def hear(self, message: Any, topic: str) -> None:
        """Take a tf2_msgs/TFMessage. Raises BadMessage: a transform is none."""
        for told in message.transforms:
            place, turn = told.transform.translation, told.transform.rotation
            p, q = np.array([place.x, place.y, place.z]), np.array([turn.x, turn.y, turn.z, turn.w])
            child = told.child_frame_id.lstrip("/")
            length = float(norm(q))
            if not (np.isfinite(p).all() and 0.7 < length < 1.4):
                raise BadMessage(f"{topic}: the transform of {child} is none")
            T = kin.transform(_rotation(q / length), p)
            self._parents[child] = (told.header.frame_id.lstrip("/"), T, stamp_of(told.header))

    def has(self, frame: str, child: str) -> bool:
        """Whether a frame can be placed in another."""
        return bool({*self._above(frame)} & {*self._above(child)})

    def stamp_ns(self, child: str) -> int:
        """When a frame was placed in its parent."""
        return self._parents[child][2]

    def place(self, frame: str, child: str) -> Array:
        """T_frame_child (4, 4). Raises BadMessage: a frame is not there, or the two are not connected."""
        common = next((name for name in self._above(frame) if name in self._above(child)), None)
        if common is None:
            raise BadMessage(self.why(frame, child))
        return matmul(kin.inverse(self._to(common, frame)), self._to(common, child))

    def why(self, frame: str, child: str) -> str:
        """Why a frame cannot be placed in another, in words."""
        known = sorted({*self._parents, *(parent for parent, _, _ in self._parents.values())})
        for name in (frame, child):
            if name not in known:
                return f"{self._file}: the frame {name!r} is not in tf.{did_you_mean(nearest(name, known), known)}"
        return f"{self._file}: tf does not connect the frames {frame!r} and {child!r}"

    def _above(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up."""
        chain = [frame] if frame in self._parents or any(frame == p for p, _, _ in self._parents.values()) else []
        while chain and chain[-1] in self._parents and len(chain) <= len(self._parents):
            chain.append(self._parents[chain[-1]][0])
        return chain

    def _to(self, above: str, frame: str) -> Array:
        """T_above_frame (4, 4)."""
        T = np.eye(4)
        while frame != above:
            frame, step, _ = self._parents[frame]
            T = matmul(step, T)
        return T


def _rotation(q: Array) -> Array:
    """(3, 3) of a unit quaternion xyzw."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
