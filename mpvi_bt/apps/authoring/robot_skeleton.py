"""A robot's file to begin with, as `mpvi new robot` writes it: what a URDF does not tell is guessed, and said."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from mpvi_bt.apps.authoring.skeletons import Skeleton, checked_name
from mpvi_bt.ground import paths
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.base_reading import base_link
from mpvi_bt.ground.robot.kinematic_chain import BaseFrame
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robot_shapes import link_points
from mpvi_bt.ground.robot.robots import FOLDER
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, UrdfTree, read_urdf_tree

BaseKind = Literal["holonomic", "differential"]
_WHEEL = re.compile("wheel|caster|roller|steer")
_FINGER = re.compile("finger|gripper|jaw|knuckle|thumb")
_TORSO = re.compile("torso|waist|spine|trunk|lift_?joint|column")
_CAMERA = re.compile("camera|optical|rgb|realsense|kinect")
_TCP = re.compile("tcp|eef|end_effector|tool|grasp")
_RADIUS_M, _SPEED, _TURN = 0.3, 0.5, 1.0  # our choice, where a URDF tells nothing: of a slow indoor base
_JOINT_SPEED, _OPENING_M, _FOV_RAD = 1.0, 0.08, 0.75  # our choice likewise
_LEAST_M = 0.2  # our choice: no base with an arm is smaller; the foot of an arm is
_BELOW_M = 0.03  # our choice: wheels and pads of rubber are drawn as deep
_CLEAR_M = 0.01  # our choice: what touches the floor of our house holds the base
_BOXY = 0.9  # our choice: of the circle about a base, a box that is smaller is its outline
_ARM_JOINTS = 4  # our choice: a way with fewer moving joints is no arm, but a head or a leg


def new_robot(name: str, urdf: Path, root: Path, base: BaseKind | None = None) -> Skeleton:
    """A robot's file, written for a URDF.

    Args:
        name: Of the robot.
        urdf: File of its URDF.
        root: The folder that `robots/` is in.
        base: How it drives; None: guessed from its wheels.

    Raises:
        UserError: The name is none or taken, or there is no such file.
        FileProblems: What is wrong with the URDF.
    """
    checked_name("robot", name, paths.names(FOLDER))
    guess = _Guess(read_urdf_tree(urdf))
    content = {"urdf": os.path.relpath(urdf, root / FOLDER), **guess.content(base)}
    comment = "".join(f"# {line}\n" for line in ("What is guessed here; look at it before it drives:", *guess.said))
    text = comment + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)
    return Skeleton({f"{FOLDER}/{name}.yaml": text}, (f"mpvi check ROOT/{FOLDER}/{name}.yaml",), tuple(guess.said))


class _Guess:
    """What a URDF tells of a robot. `said`: a line for each guess."""

    def __init__(self, tree: UrdfTree) -> None:
        self._tree = tree
        self._base = BaseFrame(tree, base_link(tree), 0.0)
        self.said: list[str] = []

    def content(self, base: BaseKind | None) -> dict[str, Any]:
        """All of the file but the URDF's name."""
        hands = self._hands() or self._bare_hands()
        ways = {hand: [j for j in self._way(hand) if j.moves and not _WHEEL.search(j.name.lower())] for hand in hands}
        torso = self._torso(list(ways.values()))
        arms = {hand: [joint for joint in way if joint not in torso] for hand, way in ways.items()}
        sides = self._sides({hand: hands[hand] for hand, way in arms.items() if way})
        cameras = self._cameras({side: hand for hand, side in sides.items()})
        if "head" in cameras:
            above = self._way(cameras["head"]["link"])
            torso += [j for j in above if j.moves and j not in torso and not _WHEEL.search(j.name.lower())]
        found: dict[str, Any] = {"base": self._base_part(base), "cameras": cameras}
        if torso:
            found["torso"] = self._group(torso)
        if sides:
            by_side = sorted(sides.items(), key=lambda item: SIDES.index(item[1]))
            found["arms"] = {side: self._group(arms[hand]) for hand, side in by_side}
            self.said.append("arms: no travel posture is in a URDF, so that it drives with all joints at or next to 0")
            found["grippers"] = {side: self._gripper(side, hand, hands[hand]) for hand, side in by_side}
        else:
            self.said.append(
                "arms: none: no joint of a gripper was found by its name (finger, gripper, jaw), and no single way of "
                f"{_ARM_JOINTS} joints or more"
            )
        return found

    def _way(self, link: str) -> list[UrdfJoint]:
        return self._tree.path(link, self._base.link) or []

    def _place(self, link: str) -> Array:
        """(3,) of a link in the base frame, all joints at 0."""
        return self._base.chain(link, np.eye(4), ()).pose(np.zeros(0))[:3, 3]

    def _hands(self) -> dict[str, list[UrdfJoint]]:
        """The joints of fingers by the link that they hang on."""
        found: dict[str, list[UrdfJoint]] = {}
        for joint in self._tree.joints.values():
            if joint.moves and _FINGER.search(f"{joint.name} {joint.child}".lower()) and self._way(joint.child):
                way = [above for above in self._way(joint.child) if above.moves]
                if len(way) < 2 or not _FINGER.search(f"{way[-2].name} {way[-2].child}".lower()):
                    found.setdefault(joint.parent, []).append(joint)
        return found

    def _bare_hands(self) -> dict[str, list[UrdfJoint]]:
        """The last links of one or two ways with as many joints as an arm has, each without a finger that moves."""
        ends: dict[str, list[UrdfJoint]] = {}
        for link in self._tree.links:
            moving = [joint for joint in self._way(link) if joint.moves and not _WHEEL.search(joint.name.lower())]
            below = (joint for joint in self._tree.joints.values() if joint.moves and joint not in moving)
            if len(moving) >= _ARM_JOINTS and not any(moving[-1] in self._way(joint.child) for joint in below):
                ends[moving[-1].child] = []
        return ends if len(ends) <= 2 else {}

    def _torso(self, ways: Sequence[list[UrdfJoint]]) -> list[UrdfJoint]:
        """Joints that all hands hang on, if there are two; of a single one the first that are named so."""
        if len(ways) > 1:
            return [joint for joint in ways[0] if all(joint in way for way in ways)]
        return [joint for way in ways for joint in takewhile(lambda j: _TORSO.search(j.name.lower()), way)]

    def _sides(self, hands: dict[str, list[UrdfJoint]]) -> dict[str, Side]:
        """The side of each hand; only arms that have joints, and at most two."""
        if len(hands) == 1:
            return dict.fromkeys(hands, "right")
        order = sorted(hands, key=lambda hand: -float(self._place(hand)[1]))
        if len(order) > 2:
            self.said.append(f"arms: the leftmost and the rightmost of {len(order)}")
        return {order[0]: "left", order[-1]: "right"} if order else {}

    def _base_part(self, kind: BaseKind | None) -> dict[str, Any]:
        turning = [j for j in self._tree.joints.values() if j.kind == "continuous"]
        wheels = [j for j in turning if "wheel" in f"{j.name} {j.child}".lower()]
        if kind is None:
            kind = "holonomic" if len(wheels) > 2 else "differential"
            self.said.append(f"base.kind: {kind}, of {len(wheels)} joints of wheels")
        if not wheels:
            self.said.append(
                "base: no joint of a wheel was found. Of an arm alone, what carries it is its base: footprint_m, and "
                "above_floor_m, how high its first link is above the floor"
            )
        low = self._lowest()
        if low < -_BELOW_M:
            self.said.append(
                f"base.above_floor_m: {_CLEAR_M - low:.3f}, so that no link is on the floor, all joints at 0"
            )
        outline = self._outline()
        if outline is None:
            spread = [float(norm(self._place(wheel.child)[:2])) for wheel in wheels]
            outline = round(max(spread) + 0.05, 3) if spread else _RADIUS_M
            source = "where its wheels are" if spread else "nothing: measure it"
        else:
            source = "the shapes that are fixed to its base"
        self.said.append(f"base.footprint_m: {outline}, from {source}")
        self.said.append("base.speed: slow, as no URDF tells it")
        sideways = {"sideways": _SPEED} if kind == "holonomic" else {}
        return {
            "kind": kind,
            "link": self._base.link,
            **({"above_floor_m": round(_CLEAR_M - low, 3)} if low < -_BELOW_M else {}),
            "footprint_m": outline,
            "speed": {"ahead": _SPEED, **sideways, "turn": _TURN},
        }

    def _lowest(self) -> float:
        """The height of the lowest point of its shapes in the base frame, all joints at 0; 0 if it has none."""
        folder, low = Path(self._tree.file).resolve().parent, 0.0
        for name, link in self._tree.links.items():
            if self._tree.path(name, self._base.link) is not None:
                T = self._base.chain(name, np.eye(4), ()).pose(np.zeros(0))
                for points in link_points(link, folder):
                    low = min(low, float((matmul(points, T[2, :3]) + T[2, 3]).min()))
        return low

    def _outline(self) -> float | list[list[float]] | None:
        """Of the shapes of links that are fixed to the base: a radius, or corners where a box is far smaller.

        None: there are no shapes, or they are too small for a base.
        """
        folder, found = Path(self._tree.file).resolve().parent, []
        for name, link in self._tree.links.items():
            way = self._tree.path(name, self._base.link)
            if way is None or any(joint.kind != "fixed" for joint in way):
                continue
            T = self._base.chain(name, np.eye(4), ()).pose(np.zeros(0))
            found += [matmul(points, T[:3, :3].T)[:, :2] + T[:2, 3] for points in link_points(link, folder)]
        places = np.concatenate([*found, np.zeros((1, 2))])
        radius = float(norm(places, axis=1).max())
        if radius < _LEAST_M:
            return None
        (x0, y0), (x1, y1) = places.min(0).round(3).tolist(), places.max(0).round(3).tolist()
        if max(x0, y0) < 0 < min(x1, y1) and (x1 - x0) * (y1 - y0) < _BOXY * np.pi * radius**2:
            return [[x1, y0], [x1, y1], [x0, y1], [x0, y0]]
        return round(radius, 3)

    def _cameras(self, hands: dict[Side, str]) -> dict[str, Any]:
        """By name: the first of the base, torso or head, and the first of each arm. Optical frames go first."""
        named = [name for name in self._tree.links if _CAMERA.search(name.lower()) and self._tree.path(
            name, self._base.link) is not None]  # fmt: skip
        named.sort(key=lambda name: ("optical" not in name, "depth" in name, "screw" in name))
        own = {side: {j.name for j in self._way(hand) if j.moves} for side, hand in hands.items()}
        shared = set.intersection(*own.values()) if len(own) > 1 else set()
        found: dict[str, Any] = {}
        for link in named:
            above = {joint.name for joint in self._way(link) if joint.moves}
            far = [side for side, joints in own.items() if len(above & (joints - shared)) > len(joints - shared) / 2]
            name: str = far[0] if far else "head"
            if name not in found:
                found[name] = {"link": link, "size": [640, 480], "fov_rad": _FOV_RAD, "depth": True}
        if "head" not in found:
            place = f"link: {self._base.link}, xyz: [0.1, 0.0, 1.2], rpy: [0.0, 0.5, 0.0]"
            example = f"head: {{ {place}, size: [640, 480], fov_rad: {_FOV_RAD:g}, depth: true }}"
            self.said.append(f"cameras.head: no link of a camera is on base or head: write it, such as {example}")
        for name, part in found.items():
            self.said.append(
                f"cameras.{name}: by the name of {part['link']}; size, fov_rad and depth are not in a URDF"
            )
        return {name: found[name] for name in ("head", *SIDES) if name in found}

    def _group(self, joints: Sequence[UrdfJoint]) -> dict[str, Any]:
        part: dict[str, Any] = {"joints": [joint.name for joint in joints]}
        if not all(joint.velocity for joint in joints):
            part["speed"] = [joint.velocity or _JOINT_SPEED for joint in joints]
            slow = ", ".join(joint.name for joint in joints if not joint.velocity)
            self.said.append(f"speed of {slow}: {_JOINT_SPEED:g}, as the URDF has none")
        return part

    def _gripper(self, side: Side, hand: str, fingers: Sequence[UrdfJoint]) -> dict[str, Any]:
        below = [name for name in self._tree.links if (way := self._tree.path(name, hand)) is not None and all(
            joint.kind == "fixed" for joint in way)]  # fmt: skip
        named = next((name for name in below if _TCP.search(name.lower())), None)
        if named is not None:
            tcp: dict[str, Any] = {"link": named}
            self.said.append(f"grippers.{side}.tcp: link {named}, by its name; z has to point along the fingers")
        elif not fingers:
            tcp = {"link": hand}
            self.said.append(f"grippers.{side}.tcp: on {hand}, the last link; z has to point along the gripper")
        else:
            middle = np.mean([joint.xyz for joint in fingers], axis=0)
            forward = abs(middle[0]) >= abs(middle[2])
            xyz = [round(float(x), 4) for x in middle * np.array([1.0, 0.0, 0.0] if forward else [0.0, 0.0, 1.0])]
            tcp = {"link": hand, "xyz": xyz, "rpy": [0.0, 1.5708, 0.0] if forward else [0.0, 0.0, 0.0]}
            along = "x" if forward else "z"
            self.said.append(f"grippers.{side}.tcp: on {hand} where its fingers begin, which point along its {along}")
        part: dict[str, Any] = {"joints": [joint.name for joint in fingers], "tcp": tcp}
        if not fingers or any(joint.kind != "prismatic" for joint in fingers):
            part["opening_m"] = _OPENING_M
            why = "its fingers turn" if fingers else "the URDF has no joint of a finger"
            self.said.append(f"grippers.{side}.opening_m: {_OPENING_M:g}, as {why}: measure it")
        return part
