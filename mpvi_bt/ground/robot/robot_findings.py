"""What does not fit between a robot's file and its URDF, each with its place."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, Location, SourceMarks
from mpvi_bt.ground.robot.robot_file import FramePart
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, UrdfTree


class RobotFindings:
    """Collects the problems of one file.

    Args:
        marks: Places in the file.
        tree: The URDF.
    """

    def __init__(self, marks: SourceMarks, tree: UrdfTree) -> None:
        self.tree = tree
        self._marks = marks
        self._problems: list[Problem] = []
        self._taken: dict[str, str] = {}  # joint to the group that has it

    def tell(self, at: Location, code: str, message: str, key: bool = False) -> None:
        """Note a problem of a value; of its key if `key`."""
        self._problems.append(self._marks.problem(at, code, message, key))

    def unknown(self, at: Location, noun: str, name: str, known: Iterable[str], whose: str | None = None) -> None:
        """Note a name that is none, with the nearest; by default one that the URDF does not have."""
        of = f" of {Path(self.tree.file).name}" if whose is None else whose
        self._problems.append(self._marks.unknown(at, noun, name, known, whose=of))

    def any(self) -> bool:
        """Whether there is a problem so far."""
        return bool(self._problems)

    def stop_if_wrong(self) -> None:
        """Raise FileProblems if there is a problem so far."""
        if self._problems:
            raise FileProblems(self._problems[:MAX_PROBLEMS])

    def check_frame(self, at: Location, frame: FramePart, base_link: str) -> None:
        """Tell if there is no such link, or it does not hang below the base frame."""
        if frame.link not in self.tree.links:
            self.unknown((*at, "link"), "link", frame.link, self.tree.links)
        elif self.tree.path(frame.link, base_link) is None:
            message = f"link {frame.link!r} does not hang below the base frame {base_link!r}"
            self.tell((*at, "link"), "out-of-range", message)

    def take(self, name: str, at: Location, group: str) -> UrdfJoint | None:
        """The joint of that name, for a group of joints; None if it cannot be commanded, and it is told why."""
        joint = self.tree.joints.get(name)
        if joint is None:
            self.unknown(at, "joint", name, [joint.name for joint in self.tree.joints.values() if joint.moves])
            return None
        if joint.mimic is not None:
            self.tell(at, "out-of-range", f"joint {name!r} follows {joint.mimic[0]!r} (mimic): name that one")
            return None
        if not joint.moves:
            self.tell(at, "out-of-range", f"joint {name!r} is {joint.kind}: it cannot be commanded")
            return None
        if name in self._taken:
            self.tell(at, "duplicate", f"joint {name!r} is of {self._taken[name]} already")
            return None
        self._taken[name] = group
        return joint
