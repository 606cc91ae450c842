"""Looking at a thing: where to point the head, and how to bend so that the hands do not hide it.

Where a head does not tilt, the trunk bends instead, what the hands hold staying where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.motion import Actions
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.hands.motion.work import NEAR_M, Work


@dataclass(frozen=True)
class Gaze:
    """How the head looks.

    Our choice, by the view of its camera.
    """

    up_rad: float = 0.5  # turn from a look at a thing to a look above it [rad]
    down_rad: float = 0.65  # turn to a look below a thing that is high up [rad]
    floor_rad: float = 0.9  # tilt that shows the floor ahead [rad]
    eyes_m: float = 0.80  # a thing this much above the lift's height is well before the eyes [m]
    still: float = 0.01  # motion of the base and of joints that stand still [m, rad]
    level_rad: float = 0.3  # a head tilted less than this does not see the floor before it [rad]
    hands_rad: float = 0.9  # tilt from the chest's horizon that sees past the folded hands [rad]
    dip_m: float = 0.06  # room below hanging hands to leave a low posture [m]


_GAZE = Gaze()
# Our choice, by the boards of shelves and by what the trunk reaches: where to look above a thing, and from.
_ABOVE = np.array([[0.0, 0.0, z] for z in (0.2, 0.28, 0.36, 0.44)])  # a thing, where a board may be
_WITHIN_RAD = 0.2  # Our choice: what is so far within the edge of the picture is in view of a head that does not tilt
_HALF_VIEW_RAD = 0.6  # what the picture of a head that tilts shows above and below its middle
_BOWS_RAD = np.arange(0.0, 0.95, 0.1)  # pitches of the trunk to look down with
_FACING = 5  # Our choice: heights of an upright trunk that are tried, the lowest first
_BOWED = (1.0, 0.6, 0.3)  # of the way to one, where there is no room for all of it
_OVERLOOKS = ((0.42, 0.0), (0.42, 0.5), (0.42, 0.8), (0.25, 0.8), (0.25, 1.1), (0.1, 1.1))  # lift [m], pitch [rad]


def study(work: Work, name: str | None) -> Actions:
    """Look at a thing, and above it, or below what is high up; nothing where the scene needs no looks.

    Without a name it looks at the floor ahead.
    """
    if not work.scene.needs_looks:
        return
    if name is None:
        yield from look_down(work, _GAZE.floor_rad)
        yield from work.see("head")
    else:
        over = [_raised(work, name)] if work.held() else _overlooking(work, name)
        yield from work.motion.stand(over[0] if over else work.motion.torso)
        yield from look_at(work, name)
        if not work.held() and _covered(work, name):
            yield from work.motion.stand(_facing(work, name))
            yield from look_at(work, name)
            work.studied = (name, _stands(work))
            return
    tilt = float(work.motion.posture[3])
    yield from work.motion.stand(
        work.motion.bent(tilt=tilt + (_GAZE.down_rad if tilt < _GAZE.level_rad else -_GAZE.up_rad))
    )
    yield from work.see("head")
    work.studied = (name, _stands(work))


def studied(work: Work, name: str | None) -> bool:
    """Whether a thing was the last to be studied, and neither base nor arms have moved since."""
    return (
        work.studied is not None
        and work.studied[0] == name
        and bool(np.abs(work.studied[1] - _stands(work)).max() < _GAZE.still)
    )


def _stands(work: Work) -> Array:
    """How base and arms stand, as felt [m, rad]."""
    felt = work.motion.felt
    return np.concatenate([felt.base_pose, *(felt.arm[side] for side in felt.sides)])


def look_into(work: Work, name: str) -> Actions:
    """Look at a thing from as high above it as the torso brings the eyes; one that holds something is not bent."""
    postures = [_raised(work, name)] if work.held() else _overlooking(work, name) or [work.motion.torso]
    middle = matmul(kin.inverse(work.base), np.append(work.middle(name), 1.0))[:3]

    def steepness(torso: Array) -> float:
        down = work.motion.robot.head_camera(torso)[:3, 3] - middle
        return float(np.arctan2(down[2], -down[0]))

    yield from work.motion.stand(max(postures, key=steepness))
    yield from look_at(work, name)


def look_at(work: Work, *names: str) -> Actions:
    """Tilt the head so that the middle of things is in the middle of its view, up or down, and look."""
    yield from turn_to(work, np.mean([work.middle(name) for name in names], axis=0))
    yield from work.see("head")


def turn_to(work: Work, p_world: Array) -> Actions:
    """Bring a point (3,) into the middle of the head's view, up or down; where the head does not tilt, into view."""
    if work.motion.robot.nods:
        yield from work.motion.stand(tilted(work, p_world))
        return
    p = matmul(kin.inverse(work.base), np.append(p_world, 1.0))
    pitch = float(work.motion.posture[2])
    bows = [pitch, *_BOWS_RAD[pitch < _BOWS_RAD]]
    yield from _bow(work, next((bow for bow in bows if _in_view(work, bow, p)), bows[-1]))


def look_down(work: Work, tilt_rad: float) -> Actions:
    """Tilt the head so far down; where it does not tilt, the trunk bends until the picture reaches as far down."""
    robot = work.motion.robot
    if robot.nods:
        yield from work.motion.stand(work.motion.bent(tilt=tilt_rad))
        return
    forward = robot.head_to_camera[:3, 2]
    lowest = float(np.arctan2(-forward[2], forward[0])) + robot.cameras["head"].fov_rad / 2
    yield from _bow(work, max(0.0, tilt_rad + _HALF_VIEW_RAD - lowest))


def _in_view(work: Work, pitch: float, p: Array) -> bool:
    """Whether a point (4,) in the base frame is not below the picture of the head at a pitch of the trunk."""
    robot = work.motion.robot
    _, down, ahead, _ = matmul(kin.inverse(robot.head_camera(work.motion.bent(pitch=pitch))), p)
    return bool(np.arctan2(down, ahead) < robot.cameras["head"].fov_rad / 2 - _WITHIN_RAD)


def _bow(work: Work, pitch: float) -> Actions:
    """Bend the trunk to a pitch [rad], or as far as there is room, what the hands hold staying where it is."""
    now = float(work.motion.posture[2])
    if abs(pitch - now) < _GAZE.still or squeezes(work.motion.felt):
        return
    taken = [s for s in work.motion.robot.sides if work.scene.holding(s) is not None or work.gripped(s)]
    body, hands = work.body(), {s: arm_motion.stay(work.motion.hand(s)) for s in taken}
    for share in _BOWED:
        torso = work.motion.bent(pitch=now + share * (pitch - now))
        if (arms := arm_motion.sweep(body, torso, hands)) is not None:
            yield from work.motion.stand(torso, arms)
            return


def tilted(work: Work, p_world: Array) -> Array:
    """The torso (4,) as it is, but with a point (3,) in the middle of the head's view, up or down."""
    torso = work.motion.torso
    seen = matmul(kin.inverse(matmul(work.base, work.motion.robot.chest(torso))), np.append(p_world, 1.0))
    ahead = seen[:3] - work.motion.robot.head_m
    down = np.arctan2(-ahead[2], max(float(ahead[0]), 0.05))
    return work.motion.bent(tilt=float(np.clip(down, *work.motion.robot.trunk.limits[3])))


def _raised(work: Work, name: str) -> Array:
    """A torso (4,) from which what is high up is seen from the front, with hands that hold something."""
    raised, now = work.motion.torso, work.motion.posture[0]
    wanted = float(np.clip(work.middle(name)[2] - _GAZE.eyes_m, *work.motion.robot.trunk.limits[0]))
    if wanted <= now:
        return raised
    body = work.body({name})
    for lift in np.linspace(now, wanted, 5)[1:]:
        torso = work.motion.bent(lift=lift)
        if not replace(body, torso=torso).all_free():
            break
        raised = torso
    return raised


def _overlooking(work: Work, name: str) -> list[Array]:
    """Torsos (n, 4) in which the folded hands do not hide a thing from the head, the least bent first."""
    middle, robot = work.middle(name), work.motion.robot
    body, T = work.body({name}), kin.inverse(work.base)
    found = []
    for lift, pitch in _OVERLOOKS:
        posture = np.array([max(lift, min(0.55, float(middle[2]) - 0.65)), 0.0, pitch, work.motion.posture[3]])
        posture[:3] = np.clip(posture[:3], *robot.trunk.limits[:3].T)
        torso = robot.trunk.joints(posture)
        seen = matmul(kin.inverse(robot.chest(torso)), T, np.append(middle, 1.0))[:3]
        ahead = seen - robot.head_m - robot.head_to_camera[:3, 3]
        if np.arctan2(-ahead[2], max(float(ahead[0]), 0.0)) < _GAZE.hands_rad and _can_stand(body, torso):
            found.append(torso)
    return found


def _facing(work: Work, name: str) -> Array:
    """A torso (4,) upright and as low as a thing is to be looked into, or as low as the hanging hands have room."""
    trunk, body, posture = work.motion.robot.trunk, work.body({name}), work.motion.posture
    lowest = float(np.clip(work.middle(name)[2] - _GAZE.eyes_m, *trunk.limits[0]))
    for lift in np.linspace(lowest, max(lowest, float(posture[0])), _FACING):
        # a little lower, too: on its way to another posture the trunk dips
        low, torso = trunk.joints(np.array([(max(lift - _GAZE.dip_m, trunk.limits[0, 0]), 0, 0, posture[3]),
                                            (lift, 0, 0, posture[3])]))  # fmt: skip
        if replace(body, torso=low).all_free() and _can_stand(body, torso):
            return torso
    return work.motion.torso


def _can_stand(body: Body, torso: Array) -> bool:
    """Whether a torso (4,) is free, and the way to it, the arms riding along: low down hands would meet the base."""
    return replace(body, torso=torso).all_free() and arm_motion.sweep(body, torso, {}) is not None


def _covered(work: Work, name: str) -> bool:
    """Whether something is above a thing, or hides what is there: that is looked into from lower down."""
    middle = work.middle(name)
    around = work.scene.obstacles(middle[:2], NEAR_M, without=work.carried() | {name})
    return bool((around.distance(middle + _ABOVE) < 0.03).any())
