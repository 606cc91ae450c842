"""Where a robot looks from: postures before things, its hands in view or folded, and things between its fingers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.eyes.scenes import PictureScene
from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.perception.segments import FLOOR, kind_of
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage, Side

# All our choice.
_WRIST = 0.33  # of the pictures are a wrist camera's
_FOLDED = 0.5  # of the head's pictures have both arms as in driving
_HELD = 0.35  # of the arms that are not folded hold something
_FURNITURE = 0.25  # of the pictures aim at furniture
_NEAR_M, _FAR_M = 0.45, 4.0  # the base from what it looks at
_ASKEW_RAD = 0.3
_POSTURES = 1500  # random ones of an arm, from which one is chosen
_HAND_M = 0.35  # a hand is up to so far from what a wrist camera looks at
_BODY_M = 0.22  # around the base's center
_TRIES = 400
_CLOSE_M, _CLOSED_IN = 0.08, 0.04  # a picture with so much so near has its camera in something
_EMPTY = 0.97  # of background: nothing to learn


def look_around(scene: PictureScene, count: int, rng: np.random.Generator) -> Iterator[CameraImage]:
    """Pictures of a scene, up to so many."""
    poser = _Poser(scene, rng)
    taken = 0
    for _ in range(_TRIES):
        image = poser.wrist() if rng.random() < _WRIST else poser.head()
        poser.let_go()
        if image is None or not _worthwhile(image):
            continue
        yield image
        taken += 1
        if taken == count:
            return


def _worthwhile(image: CameraImage) -> bool:
    assert image.labels is not None
    kinds = {id_: kind_of(name) for id_, name in image.names.items()}
    ids, counts = np.unique(image.labels, return_counts=True)
    seen = sum(n for id_, n in zip(ids.tolist(), counts.tolist(), strict=True) if kinds.get(id_, "") not in ("", FLOOR))
    own = np.isin(image.labels, [id_ for id_, kind in kinds.items() if kind == ROBOT])
    close = (image.depth > 0) & (image.depth < _CLOSE_M) & ~own
    return bool(seen > (1 - _EMPTY) * image.labels.size and close.mean() < _CLOSED_IN and own.mean() < 0.8)


class _Poser:
    """Puts the robot of a scene anywhere, at once."""

    def __init__(self, scene: PictureScene, rng: np.random.Generator) -> None:
        self._scene, self._rng, self._world = scene, rng, scene.world
        self._robot, self._model = scene.world.robot, scene.world.robot.model
        order = [joint.name for joint in self._robot.articulation.active_joints]
        physics = self._robot.physics
        self._base = [order.index(name) for name in physics.base_joints]
        self._torso = [(k, order.index(name)) for k, name in enumerate(self._model.torso_joints) if name is not None]
        self._arm = {side: [order.index(name) for name in names] for side, names in self._model.arm_joints.items()}
        self._fingers = {side: [(order.index(f.joint), f) for f in group] for side, group in physics.fingers.items()}
        solid = [f for name, f in scene.house.fixtures.items() if kind_of(name) and any(True for _ in f.solids())]
        self._boxes = [fixture.extent() for fixture in solid]
        self._boxes = [box for box in self._boxes if box[0, 2] < 1.2 and box[1, 2] > 0.03]
        self._moved: dict[str, Array] = {}

    def head(self) -> CameraImage | None:
        """The head looks at something; None if no place was found for that."""
        at = self._target()
        for _ in range(30):
            bearing = self._rng.uniform(-np.pi, np.pi)
            far = np.exp(self._rng.uniform(np.log(_NEAR_M), np.log(_FAR_M)))
            xy = at[:2] - far * np.array([np.cos(bearing), np.sin(bearing)])
            if self._free(xy):
                break
        else:
            return None
        base = np.array([*xy, bearing + self._rng.normal(0, _ASKEW_RAD)])
        arms = {side: np.asarray(self._model.travel_arm[side], float) for side in self._model.sides}
        held: list[Side] = []
        if self._rng.random() > _FOLDED:
            for side in arms:
                if self._rng.random() < 0.7:
                    arms[side] = self._forward_arm(side)
                    held += [side] if self._rng.random() < _HELD else []
        torsos = [self._any_torso() for _ in range(16)]
        eyes = [matmul(_planar(base), self._model.head_camera(torso)) for torso in torsos]
        off = [np.arccos(np.clip(_cosine(T, at), -1, 1)) + abs(self._rng.normal(0, 0.2)) for T in eyes]
        self._stand(base, torsos[int(np.argmin(off))], arms)
        for side in held:
            self._hold(side)
        return self._robot.look("head")

    def wrist(self) -> CameraImage | None:
        """A hand over or before something, or with something in it."""
        side: Side = self._model.sides[int(self._rng.integers(len(self._model.sides)))]
        at, torso = self._target(), self._any_torso()
        limits = self._model.arm_limits[side]
        postures = self._rng.uniform(np.maximum(limits[:, 0], -3), np.minimum(limits[:, 1], 3), (60, len(limits)))
        best: tuple[float, Array, Array] | None = None
        for q in postures:
            tcp = self._model.tcp(torso, q, side)
            ahead = tcp[:3, 2]
            above = tcp[2, 3] - at[2]
            if tcp[0, 3] < 0.25 or not -0.05 < above < _HAND_M:
                continue
            away = self._rng.uniform(0.0, _HAND_M)
            reach = tcp[:3, 3] + away * ahead
            cost = abs(reach[2] - at[2]) + 0.15 * self._rng.random()
            if best is None or cost < best[0]:
                best = cost, q, reach
        if best is None:
            return None
        _, q, reach = best
        yaw = self._rng.uniform(-np.pi, np.pi)
        turned = matmul(_planar(np.array([0, 0, yaw])), [*reach, 1.0])[:2]
        arms = {s: np.asarray(self._model.travel_arm[s], float) for s in self._model.sides} | {side: q}
        self._stand(np.array([*(at[:2] - turned + self._rng.normal(0, 0.04, 2)), yaw]), torso, arms)
        if self._rng.random() < _HELD:
            self._hold(side)
        return self._robot.look(side)

    def let_go(self) -> None:
        """Put what was held back."""
        for name, T in self._moved.items():
            self._world.place(name, T)
        self._moved.clear()

    def _target(self) -> Array:
        """(3,) the middle of a thing."""
        objects = list(self._world.objects)
        if objects and self._rng.random() > _FURNITURE:
            name = objects[int(self._rng.integers(len(objects)))]
            box = self._world.thing(name).description.extent(self._world.pose(name), visible=True)
        else:
            fixtures = [fixture for name, fixture in self._scene.house.fixtures.items() if kind_of(name)]
            fixture = fixtures[int(self._rng.integers(len(fixtures)))]
            box = fixture.entry.description.extent(fixture.T_world_fixture, visible=True)
        return np.asarray(box.mean(0) + self._rng.normal(0, 0.05, 3))

    def _free(self, xy: Array) -> bool:
        """Whether a base has about room there."""
        rooms = [room.rect for room in self._scene.house.rooms.values()]
        inside = any(
            x0 + _BODY_M < xy[0] < x1 - _BODY_M and y0 + _BODY_M < xy[1] < y1 - _BODY_M for x0, y0, x1, y1 in rooms
        )
        clear = all((xy + _BODY_M < box[0, :2]).any() or (xy - _BODY_M > box[1, :2]).any() for box in self._boxes)
        return inside and clear

    def _any_torso(self) -> Array:
        """(T,) of everything between driving and the limits."""
        low, high = np.asarray(self._model.torso_limits, float).T
        anywhere = self._rng.uniform(low, high)
        near = np.clip(np.asarray(self._model.travel_torso) + self._rng.normal(0, 0.15, len(low)), low, high)
        return np.where(self._rng.random(len(low)) < 0.5, near, 0.5 * (anywhere + near))

    def _forward_arm(self, side: Side) -> Array:
        """(n,) a posture with the hand before the robot."""
        limits, torso = self._model.arm_limits[side], np.asarray(self._model.travel_torso, float)
        for _ in range(40):
            q = self._rng.uniform(np.maximum(limits[:, 0], -3), np.minimum(limits[:, 1], 3))
            T = self._model.tcp(torso, q, side)
            if 0.35 < T[0, 3] < 0.9 and 0.5 < T[2, 3] < 1.4 and abs(T[1, 3]) < 0.6:
                return q
        return np.asarray(self._model.travel_arm[side], float)

    def _stand(self, base: Array, torso: Array, arms: dict[Side, Array]) -> None:
        q = self._robot.articulation.get_qpos()
        q[self._base] = base
        for k, at in self._torso:
            q[at] = torso[k]
        for side, posture in arms.items():
            q[self._arm[side]] = posture
            self._open(q, side, self._rng.uniform(0, 1) * self._model.opening_m)
        self._robot.articulation.set_qpos(q)
        self._robot.forget()

    def _open(self, q: Array, side: Side, width_m: float) -> None:
        for at, finger in self._fingers[side]:
            q[at] = finger.closed + finger.rate * width_m / 2

    def _hold(self, side: Side) -> None:
        """Put a movable thing between the fingers that fits there."""
        objects = list(self._world.objects)
        for k in self._rng.permutation(len(objects))[:8]:
            name = objects[int(k)]
            if self._world.thing(name).description.jointed or name in self._moved:
                continue
            low, high = self._world.thing(name).description.extent(visible=True)
            across = int(np.argmin((high - low)[:2]))
            width = float((high - low)[across])
            if width > self._model.opening_m or (high - low).max() > 0.35:
                continue
            self._moved[name] = self._world.pose(name)
            T = self._robot.hand_pose_world(side)
            # across the fingers along y; it stands up or lies along x; taken from above or from the side
            axes = np.eye(3)
            y = axes[across]
            z = axes[2] if self._rng.random() < 0.5 else axes[1 - across]
            z = z if self._rng.random() < 0.5 else -z
            R = np.stack([np.cross(y, z), y, z])  # body to hand
            T_hand_thing = np.eye(4)
            T_hand_thing[:3, :3] = R
            grip = self._rng.uniform(-0.3, 0.3, 3) * (high - low)
            grip[across] = 0.0
            T_hand_thing[:3, 3] = -R @ ((low + high) / 2 + grip)
            self._world.place(name, matmul(T, T_hand_thing))
            q = self._robot.articulation.get_qpos()
            self._open(q, side, width)
            self._robot.articulation.set_qpos(q)
            self._robot.forget()
            return


def _planar(base: Array) -> Array:
    """(4, 4) of a base pose (3,)."""
    c, s = np.cos(base[2]), np.sin(base[2])
    return np.array([[c, -s, 0, base[0]], [s, c, 0, base[1]], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def _cosine(T_world_camera: Array, at: Array) -> float:
    """Of the angle between the optical axis and the way to a place."""
    way = at - T_world_camera[:3, 3]
    return float(way @ T_world_camera[:3, 2] / max(float(np.linalg.norm(way)), 1e-6))
