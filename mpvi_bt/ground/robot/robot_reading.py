"""A robot's file beside its URDF: what does not fit, each with its place, and the robot that both describe."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, Location, SourceMarks, load_marked, validate_data
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.described import DescribedRobot, DescribedTrunk
from mpvi_bt.ground.robot.kinematic_chain import KinematicChain, placed
from mpvi_bt.ground.robot.mobile_base import MobileBase
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.robot_file import BasePart, CameraPart, FramePart, GripperPart, GroupPart, RobotFile
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, UrdfTree, read_urdf_tree

_ENDLESS_RAD = 3.1  # our choice: joints that turn on without end stop before half a turn, so that no path winds up
_OWN_M = 0.15  # our choice: so far beyond what is kept clear the head may still see the robot itself
_BASE_LINKS = ("base_footprint", "base_link")
_BASE_NUMBERS = ("base_vx", "base_vy", "base_yaw_rate")
_UPRIGHT = 0.7  # sine from which an axis counts as one of x, y and z


def read_robot(file: str | Path, name: str = "") -> DescribedRobot:
    """The robot of a file, by that file and its URDF alone.

    Args:
        file: Of the robot.
        name: What it is called; the file's stem by default.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it, or with its URDF.
    """
    data, marks = load_marked(file)
    return _made(data, marks, name or Path(file).stem)


def check_robot_file(data: Any, marks: SourceMarks) -> DescribedRobot:
    """The robot of a loaded file. Raises FileProblems."""
    return _made(data, marks, Path(marks.file).stem)


def lint_robot_file(data: Any, marks: SourceMarks) -> list[Problem]:
    """What may be worth knowing of a file without errors: meshes that are not there."""
    return list(check_robot_file(data, marks).tree.missing_meshes())


def _made(data: Any, marks: SourceMarks, name: str) -> DescribedRobot:
    if isinstance(data, dict) and isinstance(data.get("base"), dict) and data["base"].get("kind") == "ackermann":
        message = (
            "a base that steers like a car is not driven: ways here turn on the spot. Known: holonomic, differential"
        )
        raise FileProblems([marks.problem(("base", "kind"), "unknown-value", message)])
    expect("robot", data, marks)
    told = validate_data(data, marks, RobotFile)
    urdf = Path(marks.file).parent / told.urdf
    if not urdf.is_file():
        raise FileProblems([marks.problem(("urdf",), "unreadable", f"there is no file {str(urdf)!r}")])
    tree = read_urdf_tree(urdf)
    return _Reading(told, marks, tree).robot(name)


@dataclass(frozen=True, eq=False)
class _JointGroup:
    """Joints that are commanded together: (n,) names, limits (n, 2), top speeds (n,), travel posture (n,)."""

    joints: tuple[str, ...]
    limits: Array
    speed: Array
    travel: Array


class _Reading:
    """Puts a robot together, and notes what does not fit."""

    def __init__(self, told: RobotFile, marks: SourceMarks, tree: UrdfTree) -> None:
        self._told, self._marks, self._tree = told, marks, tree
        self._problems: list[Problem] = []
        self._taken: dict[str, str] = {}  # joint to the group that has it

    def robot(self, name: str) -> DescribedRobot:
        """The robot. Raises FileProblems."""
        told, tree = self._told, self._tree
        link = self._base_link()
        torso = self._group(told.torso, ("torso",), "the torso")
        arms = {side: self._group(told.arms[side], ("arms", side), f"the {side} arm") for side in self._sides()}
        openings = [self._opening(part, side) for side, part in told.grippers.items()]
        self._check_frames(link)
        self._stop_if_wrong()
        order, layout = self._layout(torso, arms)
        self._stop_if_wrong()
        spread = _spread(torso, order)
        trunk = self._trunk(link, order, spread, arms)
        chains, carried = self._cameras(link, order, arms)
        hands = {side: self._chain(link, told.grippers[side].tcp, (*order, *arms[side].joints)) for side in arms}
        self._stop_if_wrong()
        speed = told.base.speed
        linear = [i for i, n in enumerate(layout.names) if n in tree.joints and tree.joints[n].kind == "prismatic"]
        opening = openings[0] if openings else 0.0
        made = DescribedRobot(
            name=name,
            layout=layout,
            base=MobileBase(1.0, 1.0, 1.0, 1.0),  # until where the arms are is known
            base_speed=np.array([speed.ahead, speed.sideways or 0.0, speed.turn]),
            drive_acceleration=np.array([told.base.acceleration.ahead, told.base.acceleration.turn]),
            torso_joints=order,
            arm_joints={side: arm.joints for side, arm in arms.items()},
            finger_joints={side: tuple(told.grippers[side].joints) for side in arms},
            torso_limits=spread.limits,
            arm_limits={side: arm.limits for side, arm in arms.items()},
            torso_top_speed=spread.speed,
            arm_top_speed={side: arm.speed for side, arm in arms.items()},
            linear_joints=frozenset(linear),
            opening_m=opening,
            grasp_m=max((told.grippers[side].grasp_m for side in arms), default=0.0),
            travel_torso=spread.travel,
            travel_arm={side: arm.travel for side, arm in arms.items()},
            trunk=trunk,
            cameras={name: _camera(part) for name, part in told.cameras.items()},
            arm_m=told.arm_radius_m,
            tree=tree,
            link=link,
            camera_chains=chains,
            carried=carried,
            hands=hands,
        )
        object.__setattr__(made, "base", _base(told.base, made))
        return made

    def _tell(self, at: Location, code: str, message: str, key: bool = False) -> None:
        self._problems.append(self._marks.problem(at, code, message, key))

    def _stop_if_wrong(self) -> None:
        if self._problems:
            raise FileProblems(self._problems[:MAX_PROBLEMS])

    def _sides(self) -> Iterator[Side]:
        """Sides that have an arm and a gripper; tells of others."""
        told = self._told
        if list(told.arms) == ["left"]:
            self._tell(("arms", "left"), "unknown-value", "a robot's only arm is its 'right' one", key=True)
        for side in SIDES:
            if side in told.arms and side in told.grippers:
                yield side
            elif side in told.arms:
                self._tell(("arms", side), "missing-key", f"the {side} arm has no gripper: grippers.{side}", key=True)
            elif side in told.grippers:
                self._tell(("grippers", side), "missing-key", f"there is no {side} arm for it: arms.{side}", key=True)

    def _base_link(self) -> str:
        told, tree = self._told.base, self._tree
        if told.speed.sideways is not None and told.kind == "differential":
            self._tell(("base", "speed", "sideways"), "unknown-key", "a differential base cannot go sideways", key=True)
        if told.speed.sideways is None and told.kind == "holonomic":
            self._tell(("base", "speed"), "missing-key", "missing key 'sideways' of a holonomic base [m/s]")
        if not isinstance(told.footprint_m, float) and not _convex(told.footprint_m):
            message = "corners should go around a convex outline with the base frame's origin inside, x forward, y left"
            self._tell(("base", "footprint_m"), "out-of-range", message)
        if told.link is not None:
            if told.link not in tree.links:
                self._problems.append(
                    self._marks.unknown(("base", "link"), "link", told.link, tree.links, whose=self._of)
                )
                return tree.root
            return told.link
        return next((name for name in _BASE_LINKS if name in tree.links), tree.root)

    @property
    def _of(self) -> str:
        return f" of {Path(self._tree.file).name}"

    def _joint(self, name: str, at: Location, group: str) -> UrdfJoint | None:
        """A joint that can be commanded; else None, and it is told why."""
        joint = self._tree.joints.get(name)
        if joint is None:
            able = [joint.name for joint in self._tree.joints.values() if joint.moves]
            self._problems.append(self._marks.unknown(at, "joint", name, able, whose=self._of))
            return None
        if joint.mimic is not None:
            self._tell(at, "out-of-range", f"joint {name!r} follows {joint.mimic[0]!r} (mimic): name that one")
            return None
        if not joint.moves:
            self._tell(at, "out-of-range", f"joint {name!r} is {joint.kind}: it cannot be commanded")
            return None
        if name in self._taken:
            self._tell(at, "duplicate", f"joint {name!r} is of {self._taken[name]} already")
            return None
        self._taken[name] = group
        return joint

    def _group(self, part: GroupPart, at: Location, group: str) -> _JointGroup:
        count = len(part.joints)
        joints = [self._joint(name, (*at, "joints", i), group) for i, name in enumerate(part.joints)]
        for key in ("limits", "speed", "travel"):
            given = getattr(part, key)
            if isinstance(given, list) and len(given) != count:
                self._tell((*at, key), "wrong-length", f"{len(given)} of {count} joints: one for each, in their order")
                return _JointGroup((), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        limits, speed, travel = np.zeros((count, 2)), np.ones(count), np.zeros(count)
        for i, joint in enumerate(joints):
            if joint is None:
                continue
            narrowed = part.limits[i] if part.limits is not None else None
            limits[i] = self._limits(joint, narrowed, (*at, "limits", i), (*at, "joints", i))
            top = part.speed[i] if isinstance(part.speed, list) else part.speed or joint.velocity
            if not top:
                message = f"the URDF says no speed of joint {joint.name!r}: give `speed`, of all joints or of each"
                self._tell((*at, "joints", i), "missing-key", message)
            speed[i] = top or 1.0
            travel[i] = np.clip(0.0, *limits[i]) if part.travel is None else part.travel[i]
            if not limits[i, 0] <= travel[i] <= limits[i, 1]:
                message = f"joint {joint.name!r} goes from {limits[i, 0]:g} to {limits[i, 1]:g}, not to {travel[i]:g}"
                self._tell((*at, "travel", i), "out-of-range", message)
        return _JointGroup(tuple(part.joints), limits, speed, travel)

    def _limits(
        self, joint: UrdfJoint, given: tuple[float, float] | None, at: Location, named: Location
    ) -> tuple[float, float]:
        own = joint.limits
        if given is None:
            if own is not None:
                return own
            if joint.kind == "continuous":
                return -_ENDLESS_RAD, _ENDLESS_RAD
            self._tell(
                named, "missing-key", f"the URDF has no limits of joint {joint.name!r}: give `limits` of the group"
            )
            return 0.0, 0.0
        if given[0] > given[1]:
            self._tell(at, "out-of-range", f"the lowest, {given[0]:g}, is above the highest, {given[1]:g}")
        elif own is not None and not own[0] <= given[0] <= given[1] <= own[1]:
            message = f"the URDF has joint {joint.name!r} go from {own[0]:g} to {own[1]:g}: limits may only be narrower"
            self._tell(at, "out-of-range", message)
        return given

    def _opening(self, part: GripperPart, side: Side) -> float:
        """How far a gripper opens [m]."""
        at: Location = ("grippers", side)
        joints = [self._joint(name, (*at, "joints", i), f"the {side} gripper") for i, name in enumerate(part.joints)]
        ends = np.zeros((len(joints), 2))
        for i, joint in enumerate(joints):
            if joint is None:
                continue
            if joint.limits is not None:
                ends[i] = sorted(joint.limits, key=abs)
            elif part.open is None or part.closed is None:
                message = f"the URDF has no limits of joint {joint.name!r}: give `open` and `closed` of the gripper"
                self._tell((*at, "joints", i), "missing-key", message)
        for k, key in enumerate(("closed", "open")):
            if (given := getattr(part, key)) is None:
                continue
            if len(given) != len(joints):
                self._tell((*at, key), "wrong-length", f"{len(given)} positions of {len(joints)} joints")
                continue
            ends[:, k] = given
        if part.opening_m is not None:
            return part.opening_m
        if any(joint is not None and joint.kind != "prismatic" for joint in joints):
            message = "its fingers turn: give `opening_m`, how far they are apart when open [m]"
            self._tell(at, "missing-key", message, key=True)
        opening = sum(
            abs(float(ends[i, 1] - ends[i, 0])) * self._followed(joint)
            for i, joint in enumerate(joints) if joint is not None
        )  # fmt: skip
        if not opening and not self._problems:
            self._tell(at, "out-of-range", "open and closed are the same", key=True)
        return opening

    def _followed(self, joint: UrdfJoint) -> float:
        """How far a joint and those that follow it travel, in its own travel."""
        others = (other.mimic for other in self._tree.joints.values())
        return 1.0 + sum(abs(mimic[1]) for mimic in others if mimic is not None and mimic[0] == joint.name)

    def _check_frames(self, link: str) -> None:
        """Links that cameras and tcps are on have to hang below the base frame."""
        told = self._told
        frames: list[tuple[Location, str]] = [
            *((("cameras", name, "link"), part.link) for name, part in told.cameras.items()),
            *((("grippers", side, "tcp", "link"), part.tcp.link) for side, part in told.grippers.items()),
        ]
        for at, frame in frames:
            if frame not in self._tree.links:
                self._problems.append(self._marks.unknown(at, "link", frame, self._tree.links, whose=self._of))
            elif self._tree.path(frame, link) is None:
                self._tell(at, "out-of-range", f"link {frame!r} does not hang below the base frame {link!r}")
        if "head" not in told.cameras:
            names = ", ".join(told.cameras) or "none"
            self._tell(
                ("cameras",), "missing-key", f"the camera to search with is named 'head'; there are: {names}", True
            )
        elif not told.cameras["head"].depth:
            message = "the head camera has to measure depth (`depth: true`): maps and places come from it"
            self._tell(("cameras", "head"), "missing-key", message, key=True)
        for name, part in told.cameras.items():
            for message in _misfits(part):
                self._tell(("cameras", name), "out-of-range", message, key=True)
        openings = {side: self._fingers_opening(part) for side, part in told.grippers.items()}
        if len(set(openings.values()) - {None}) > 1:
            self._tell(("grippers",), "out-of-range", "both grippers have to open equally wide (`opening_m`)", key=True)

    def _fingers_opening(self, part: GripperPart) -> float | None:
        return part.opening_m

    def _layout(self, torso: _JointGroup, arms: dict[Side, _JointGroup]) -> tuple[tuple[str | None, ...], ActionLayout]:
        """Names of the torso's numbers, None of unused ones, and the layout of actions."""
        base = [n for n in _BASE_NUMBERS if n != "base_vy" or self._told.base.kind == "holonomic"]
        names = [*base, *torso.joints]
        for side, arm in arms.items():
            names += [*arm.joints, f"gripper_{side}"]
        at: Location = ("actions", "numbers")
        if self._told.actions is not None:
            given = self._told.actions.numbers
            known = {*names, *_BASE_NUMBERS}
            for i, n in enumerate(given):
                if n in given[:i]:
                    self._tell((*at, i), "duplicate", f"a second number {n!r}")
                elif n not in known and not n.startswith("unused"):
                    self._problems.append(self._marks.unknown((*at, i), "number", n, known))
            if left := [n for n in names if n not in given]:
                self._tell(at, "missing-key", f"no number for {', '.join(left)}")
            self._stop_if_wrong()
            names = given
        span = self._span(names, torso.joints, at, "the torso")
        order = tuple(n if n in torso.joints else None for n in names[span])
        if tuple(n for n in order if n is not None) != torso.joints:
            self._tell(at, "out-of-range", "the torso's joints stand in another order than in `torso.joints`")
        layout = ActionLayout(
            names=tuple(names),
            base=(_index(names, "base_vx"), _index(names, "base_vy"), _index(names, "base_yaw_rate")),
            torso=span,
            arm={side: self._span(names, arm.joints, at, f"the {side} arm") for side, arm in arms.items()},
            gripper={side: names.index(f"gripper_{side}") for side in arms},
        )
        for side, arm in arms.items():
            if tuple(names[layout.arm[side]]) != arm.joints:
                self._tell(at, "out-of-range", f"joints of the {side} arm have to stand together, as in `arms.{side}`")
        return order, layout

    def _span(self, names: Sequence[str], joints: Sequence[str], at: Location, whose: str) -> slice:
        """Where joints stand among numbers; what is between them has to be unused."""
        where = [names.index(n) for n in joints]
        if not where:
            return slice(3, 3)
        span = slice(min(where), max(where) + 1)
        if any(n not in joints and not n.startswith("unused") for n in names[span]):
            self._tell(at, "out-of-range", f"joints of {whose} have to stand together")
        return span

    def _chain(
        self, link: str, frame: FramePart, order: Sequence[str | None], turn: Array | None = None
    ) -> KinematicChain:
        """From the base frame on the floor to a frame; `turn`: (3, 3) of it, at last."""
        joints = self._tree.path(frame.link, link)
        assert joints is not None
        end = placed(frame.xyz, frame.rpy)
        if turn is not None:
            end = matmul(end, kin.transform(turn, (0.0, 0.0, 0.0)))
        start = kin.transform(np.eye(3), (0.0, 0.0, self._told.base.above_floor_m))
        return KinematicChain(joints, order, start, end)

    def _cameras(
        self, link: str, order: tuple[str | None, ...], arms: dict[Side, _JointGroup]
    ) -> tuple[dict[str, KinematicChain], dict[str, Side | None]]:
        chains, carried = {}, dict[str, Side | None]()
        for name, part in self._told.cameras.items():
            above = {joint.name for joint in self._tree.path(part.link, link) or ()}
            on = next((side for side, arm in arms.items() if above & set(arm.joints)), None)
            if name == "head" and on is not None:
                message = f"it is on the {on} arm: the camera to search with is on base, torso or head"
                self._tell(("cameras", name, "link"), "out-of-range", message)
            optical = "optical" in part.link if part.optical is None else part.optical
            full = order if on is None else (*order, *arms[on].joints)
            chains[name] = self._chain(link, part, full, None if optical else kin.LINK_TO_OPTICAL)
            carried[name] = on
        return chains, carried

    def _trunk(
        self, link: str, order: tuple[str | None, ...], torso: _JointGroup, arms: dict[Side, _JointGroup]
    ) -> DescribedTrunk:
        told, tree = self._told.torso, self._tree
        first = [tree.joints[arm.joints[0]].parent for arm in arms.values() if arm.joints]
        chest = self._chain(link, FramePart(link=first[0] if first else link), order)
        axes = {name: self._axis(name, link, order) for name in order if name is not None}
        guess = _guessed(axes, tree, chest, order, self._told.cameras["head"].link, link)
        parts: list[int | None] = []
        signs = np.ones(4)
        for k, (key, along) in enumerate((("lift", 2), ("turn", 2), ("bend", 1), ("tilt", 1))):
            name = getattr(told, key) or guess.get(key)
            if name is None:
                parts.append(None)
                continue
            if name not in axes:
                at: Location = ("torso", key)
                self._problems.append(self._marks.unknown(at, "joint", name, list(axes), whose=" of the torso"))
                parts.append(None)
                continue
            parts.append(order.index(name))
            signs[k] = math.copysign(1.0, axes[name][along])
        return DescribedTrunk(torso.limits, tuple(parts), signs, chest)

    def _axis(self, name: str, link: str, order: Sequence[str | None]) -> Array:
        """(3,) the axis of a joint in the base frame, all joints at 0."""
        joint = self._tree.joints[name]
        R = self._chain(link, FramePart(link=joint.child), order).pose(np.zeros(len(order)))[:3, :3]
        return matmul(R, np.array(joint.axis))


def _guessed(
    axes: dict[str, Array], tree: UrdfTree, chest: KinematicChain, order: Sequence[str | None], head: str, link: str
) -> dict[str, str]:
    """What joints of the torso do, by their axes: one that slides up lifts, about z turns, about y bends or tilts.

    Where several would do the same, none does: postures then leave them as they are.
    """
    carrying = {order[i] for i in chest.used}
    seeing = {joint.name for joint in tree.path(head, link) or ()}
    found: dict[str, list[str]] = {"lift": [], "turn": [], "bend": [], "tilt": []}
    for name, axis in axes.items():
        if tree.joints[name].kind == "prismatic":
            if abs(axis[2]) > _UPRIGHT:
                found["lift"].append(name)
        elif abs(axis[2]) > _UPRIGHT and name in carrying:
            found["turn"].append(name)
        elif abs(axis[1]) > _UPRIGHT:
            if name in carrying:
                found["bend"].append(name)
            elif name in seeing:
                found["tilt"].append(name)
    return {key: names[0] for key, names in found.items() if len(names) == 1}


def _spread(torso: _JointGroup, order: Sequence[str | None]) -> _JointGroup:
    """The torso with 0 for numbers that no joint follows."""
    where = [i for i, name in enumerate(order) if name is not None]
    limits, speed, travel = np.zeros((len(order), 2)), np.ones(len(order)), np.zeros(len(order))
    limits[where], speed[where], travel[where] = torso.limits, torso.speed, torso.travel
    return _JointGroup(torso.joints, limits, speed, travel)


def _index(names: Sequence[str], name: str) -> int | None:
    return names.index(name) if name in names else None


def _camera(part: CameraPart) -> Camera:
    width, height = part.size
    if part.fov_rad is not None:
        return Camera(width, height, part.fov_rad, part.near_m, part.far_m, part.link, None, part.depth)
    assert part.fy is not None
    fx = part.fx if part.fx is not None else part.fy
    cx = part.cx if part.cx is not None else width / 2
    cy = part.cy if part.cy is not None else height / 2
    fov_rad = 2 * math.atan(height / 2 / part.fy)
    return Camera(width, height, fov_rad, part.near_m, part.far_m, part.link, (fx, part.fy, cx, cy), part.depth)


def _misfits(part: CameraPart) -> Iterator[str]:
    """What does not fit of a camera's intrinsics."""
    width, height = part.size
    given = {key: getattr(part, key) for key in ("fx", "fy", "cx", "cy") if getattr(part, key) is not None}
    if part.fov_rad is not None and given:
        yield f"fov_rad and {', '.join(given)} say the same: give one of them"
    elif part.fov_rad is None and "fy" not in given:
        yield "missing is how wide it sees: fov_rad (vertical), or fx, fy, cx and cy of its CameraInfo"
    cx, cy = given.get("cx", width / 2), given.get("cy", height / 2)
    if not (width / 4 < cx < width * 3 / 4 and height / 4 < cy < height * 3 / 4):
        yield (
            f"cx {cx:g}, cy {cy:g} are intrinsics of a picture of about {2 * cx:.0f} x {2 * cy:.0f}, "
            f"not of {width} x {height}"
        )
    if "fx" in given and "fy" in given and not 0.5 < given["fx"] / given["fy"] < 2:
        yield f"fx {given['fx']:g} and fy {given['fy']:g} differ by more than half"
    if part.near_m >= part.far_m:
        yield f"near_m {part.near_m:g} is not nearer than far_m {part.far_m:g}"


def _convex(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether corners go around a convex outline, either way, that has the origin inside."""
    if len(corners) < 3:
        return False
    p = np.array(corners)
    along = np.roll(p, -1, 0) - p
    after = np.roll(along, -1, 0)
    turns = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    inside = along[:, 1] * p[:, 0] - along[:, 0] * p[:, 1]
    return bool(((turns > 0).all() and (inside > 0).all()) or ((turns < 0).all() and (inside < 0).all()))


def _base(part: BasePart, robot: DescribedRobot) -> MobileBase:
    """The base from above; what its file does not say of room follows from outline and arms."""
    corners = np.zeros((0, 2))
    if isinstance(part.footprint_m, float):
        radius = reach = part.footprint_m
    else:
        corners = np.array(part.footprint_m)
        after = np.roll(corners, -1, 0)
        if float((corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]).sum()) < 0:
            corners, after = corners[::-1].copy(), corners[::-1].copy()
            after = np.roll(corners, -1, 0)
        edge = after - corners
        radius = float((np.abs(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]) / norm(edge, axis=1)).min())
        reach = float(norm(corners, axis=1).max())
    beyond = [_reach(robot, side) for side in robot.sides]
    folded = part.folded_m or max([radius, *(far for far in beyond if not len(corners))])
    own = part.own_m or max([reach, folded, *beyond]) + _OWN_M
    return MobileBase(radius, folded, part.turn_m or radius, own, corners)


def _reach(robot: DescribedRobot, side: Side) -> float:
    """How far an arm in the travel posture reaches from the base frame, from above [m]."""
    points: Iterable[Array] = robot.arm_points(robot.travel_torso, robot.travel_arm[side], side)
    return max(float(norm(point[:2])) for point in points) + robot.arm_m
