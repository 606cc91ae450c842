"""The last messages of a camera, undecoded, and the picture that is made of them when somebody looks."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mpvi_bt.executive.remote.observation import Vocabulary
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.runs.ros2.bridge_file import CameraTopics
from mpvi_bt.runs.ros2.picture_messages import (
    check_size,
    color_of,
    compressed_color_of,
    depth_of,
    intrinsics_of,
    labels_of,
    names_of,
)
from mpvi_bt.runs.ros2.state_messages import NS

_KEPT = 6  # messages of each topic: depth may come a few pictures after its color
_PAIR_NS = NS // 60  # Our choice: half a picture at 30 Hz; farther apart they are of two moments
PARTS = ("color", "depth", "labels")


def raw_stamp(raw: bytes) -> int:
    """The stamp [ns] of a serialized message that begins with a header."""
    seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] & 1 else ">iI", raw, 4)
    return int(seconds) * NS + int(nanoseconds)


@dataclass(frozen=True, eq=False)
class RawPicture:
    """The undecoded messages of a picture.

    Attributes:
        stamp_ns: When it was taken, in the robot's time.
        parts: By name: color, depth, info, and labels if there are any.
    """

    stamp_ns: int
    parts: Mapping[str, bytes]


class CameraBuffer:
    """The last messages of one camera.

    Attributes:
        topics: Its topics.
        names: What labels stand for.
        vocabulary: What those things are called; None: it was not told.
    """

    def __init__(self, camera: str, topics: CameraTopics, file: str, deserialize: Callable[[bytes, str], Any]) -> None:
        """Nothing was heard yet.

        Args:
            camera: Its name.
            topics: Its topics.
            file: The bridge file, for messages.
            deserialize: Makes a message of its bytes and its part, such as "color".
        """
        self.camera, self.topics, self._file, self._deserialize = camera, topics, file, deserialize
        self._raw: dict[str, deque[tuple[int, bytes]]] = {part: deque(maxlen=_KEPT) for part in PARTS}
        self._info: bytes | None = None
        self.names: dict[int, str] = {}
        self.vocabulary: Vocabulary | None = None

    @property
    def wanted(self) -> tuple[str, ...]:
        """The parts that make a picture."""
        return PARTS if self.topics.labels else PARTS[:2]

    def put(self, part: str, raw: bytes) -> None:
        """Keep a message of color, depth, labels or info."""
        if part == "info":
            self._info = raw
        else:
            self._raw[part].append((raw_stamp(raw), raw))

    def put_names(self, text: str) -> None:
        """Take what labels stand for. Raises BadMessage."""
        self.names, self.vocabulary = names_of(text, str(self.topics.names))

    def newest(self, at_ns: int | None = None) -> RawPicture | None:
        """The newest color with all other parts of its moment; None: there is none.

        Args:
            at_ns: Only of this moment.
        """
        if self._info is None or (self.topics.labels and not self.names):
            return None
        for stamp, color in reversed(tuple(self._raw["color"])):
            parts = {"color": color, "info": self._info}
            for part in self.wanted[1:]:
                if raw := self._near(part, stamp):
                    parts[part] = raw
            if at_ns in (None, stamp) and len(parts) == len(self.wanted) + 1:
                return RawPicture(stamp, parts)
        return None

    def missing(self) -> list[str]:
        """Topics that nothing has come from."""
        silent = [str(getattr(self.topics, part)) for part in self.wanted if not self._raw[part]]
        if self._info is None:
            silent.append(self.topics.info)
        if self.topics.names and not self.names:
            silent.append(self.topics.names)
        return silent

    def picture(self, raw: RawPicture, T_world_camera: Array) -> CameraImage:
        """What `newest` found, decoded. Raises BadMessage: its parts do not fit each other."""
        message = {part: self._deserialize(bytes_, part) for part, bytes_ in raw.parts.items()}
        K, size = intrinsics_of(message["info"], self.topics.info)
        decode = compressed_color_of if self.topics.compressed else color_of
        rgb, meters = decode(message["color"], self.topics.color), depth_of(message["depth"], self.topics.depth)
        labels = None
        if self.topics.labels:
            labels = labels_of(message["labels"], self.topics.labels)
        for shape, topic in (
            (rgb.shape, self.topics.color),
            (meters.shape, self.topics.depth),
            (labels.shape if labels is not None else size, str(self.topics.labels)),
        ):
            check_size(shape, size, topic, self.topics.info, self._file)
        return CameraImage(self.camera, rgb, meters, labels, self.names, K, T_world_camera)

    def _near(self, part: str, stamp: int) -> bytes | None:
        """The message of a part that is nearest to a moment, if it is of the same."""
        kept = tuple(self._raw[part])
        if not kept:
            return None
        at, raw = min(kept, key=lambda one: abs(one[0] - stamp))
        return raw if abs(at - stamp) <= _PAIR_NS else None
