"""What networks are trained on, drawn from demonstrations and disturbed.

Our choice, measured: plain cloning fails, since a policy soon gets where no demonstration was. So states are disturbed
widely, and what is to be done there is still what the demonstration did next: the way back is part of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.learned.features import STRIDE, WAYPOINTS, Moments, TargetFrame, actor_inputs, hand_at, waypoints
from mpvi_bt.hands.learned.points import CONTEXT_POINTS, TARGET_POINTS
from mpvi_bt.hands.learned.training_set import TrainingSet

# All our choice, as above.
ACTOR_POINTS, PROPOSER_POINTS = 32, 48  # of each set that one sample has
_POINT_M = 0.002
_ARM_RAD, _TORSO, _BASE = 0.05, np.array([0.01, 0.02, 0.02, 0.04]), np.array([0.03, 0.03, 0.04])
_STANCE_TORSO = np.array([0.01, 0.01, 0.02, 0.05])
_FAR_OFF, _FAR_OFF_SHARE = 3.0, 0.3  # now and then the stance is only roughly known
_LITTLE, _LITTLE_SHARE = 0.3, 0.5  # as often the state is disturbed but little
_NEAR_M, _AT_M, _FAR_M = 0.15, 0.12, 0.35
_CLOSING = 22  # steps before an event: the hand is at work, and not disturbed
_BACK = 5  # waypoints that the way back takes
_BEGUN_RAD = 0.15  # an arm that has moved less has not left its place at the start
_APPROACH_BASE = np.array([0.08, 0.08, 0.12])


@dataclass(frozen=True, eq=False)
class ActorBatch:
    """n samples: points (n, 64, 9), all else (n, 76), waypoints (n, 168), progress (n,), weight (n,)."""

    points: Array
    told: Array
    wanted: Array
    progress: Array
    weight: Array


class Batches:
    """Draws samples from some of the episodes."""

    def __init__(self, frames: TrainingSet, episodes: NDArray[np.intp]) -> None:
        """Take frames, and the episodes that may be drawn from."""
        self.frames = frames
        now = frames.moments
        hand = now.hands_in_world[:, :3, 3]
        self._away = norm(hand_at(frames.stance)[:, :3, 3] - hand)
        self._drives = norm(now.base[frames.last, :2] - now.base[:, :2]) > _BASE[0]
        seen = (frames.look >= 0) & np.isin(frames.episode, episodes)
        self.usable = np.flatnonzero(seen)
        begun = np.abs(now.told_arm - now.told_arm[frames.first]).max(1) >= _BEGUN_RAD
        before = np.arange(len(seen)) < frames.event - _CLOSING
        self._early, self._approaching = np.flatnonzero(seen & ~begun), np.flatnonzero(seen & before)
        near = 1.0 + (self._away[self.usable] < _NEAR_M)
        self._share = near / near.sum()

    def actor(self, n: int, rng: np.random.Generator, disturbed: bool) -> ActorBatch:
        """n samples for the actor."""
        at = rng.choice(self.usable, n, p=self._share)
        f, now = self.frames, self.frames.moments
        moment, stance = _picked(now, at), f.stance[at]
        ahead = np.minimum(at[:, None] + STRIDE * np.arange(1, WAYPOINTS + 1), f.last[at][:, None])
        back = np.clip(1 - np.arange(1, WAYPOINTS + 1) / _BACK, 0, 1)[None, :, None]
        off_arm, off_torso, off_base = np.zeros((n, 7)), np.zeros((n, 4)), np.zeros((n, 3))
        if disturbed:
            free = (at < f.event[at] - _CLOSING)[:, None]
            size = np.where(rng.random((n, 1)) < _LITTLE_SHARE, 1.0, _LITTLE) * free
            off_arm = rng.normal(0, _ARM_RAD, (n, 7)) * size * (rng.random((n, 1)) < 0.7)
            off_torso = rng.normal(0, 1, (n, 4)) * _TORSO * size * (rng.random((n, 1)) < 0.5)
            moves = self._drives[at] | ((self._away[at] > _FAR_M) & (rng.random(n) < 0.5))
            off_base = rng.normal(0, 1, (n, 3)) * _BASE * moves[:, None]
            # Off its way near the grasp: first there, then close.
            lost = (np.abs(off_arm).max(1) > 0.02) & (self._away[at] < _NEAR_M) & free[:, 0]
            ahead = np.where(lost[:, None], np.minimum(ahead, (f.event[at] - _CLOSING + 1)[:, None]), ahead)
            ahead = np.maximum(ahead, at[:, None])
            moment = replace(
                moment, arm=moment.arm + off_arm, told_arm=moment.told_arm + off_arm, torso=moment.torso + off_torso,
                told_torso=moment.told_torso + off_torso, base=moment.base + off_base,
                velocity=moment.velocity + rng.normal(0, 0.03, (n, 3)),
                width=moment.width + rng.normal(0, 0.001, n),
            )  # fmt: skip
            rough = 1.0 + _FAR_OFF * (rng.random((n, 1)) < _FAR_OFF_SHARE)
            stance = stance.copy()
            stance[:, :3] += rng.normal(0, 1, (n, 3)) * _BASE * rough
            stance[:, 3:7] += rng.normal(0, 1, (n, 4)) * _STANCE_TORSO
            stance[:, 7:] += rng.normal(0, _ARM_RAD, (n, 7)) * rough
        points = self._points(at, ACTOR_POINTS, rng, disturbed)
        seen, told = actor_inputs(moment, stance, points, ACTOR_POINTS)
        wanted = waypoints(
            moment, now.base[ahead] + off_base[:, None] * back, now.told_torso[ahead] + off_torso[:, None] * back,
            now.told_arm[ahead] + off_arm[:, None] * back, now.told_grip[ahead],
        )  # fmt: skip
        progress = (at - f.first[at]) / np.maximum(f.last[at] - f.first[at], 1)
        return ActorBatch(seen, told, wanted.reshape(n, -1), progress, 1 + 2.0 * (self._away[at] < _AT_M))

    def proposer(self, n: int, rng: np.random.Generator, disturbed: bool) -> tuple[Array, Array, Array]:
        """n samples for the proposer: points (n, 96, 4), all else (n, 4) and hypotheses (n, 23).

        Half of them are of before the arm moves, half of any time before the hand closes.
        """
        at = np.where(rng.random(n) < 0.5, rng.choice(self._early, n), rng.choice(self._approaching, n))
        base = self.frames.moments.base[at]
        if disturbed:
            base = base + rng.normal(0, 1, (n, 3)) * _APPROACH_BASE
        points = self._points(at, PROPOSER_POINTS, rng, disturbed)
        frame = TargetFrame.of(base, points, PROPOSER_POINTS)
        return frame.points(points), frame.told, frame.hypothesis(self.frames.stance[at])

    def _points(self, at: NDArray[np.intp], count: int, rng: np.random.Generator, disturbed: bool) -> Array:
        """(n, 2 count, 3) of the newest samples."""
        all_points = self.frames.points[self.frames.look[at]]
        first = rng.integers(0, [TARGET_POINTS - count + 1, CONTEXT_POINTS - count + 1]) if disturbed else (0, 0)
        sets = all_points[:, first[0] :][:, :count], all_points[:, TARGET_POINTS + first[1] :][:, :count]
        points = np.concatenate(sets, 1)
        return points + rng.normal(0, _POINT_M, points.shape) if disturbed else points


def _picked(now: Moments, at: NDArray[np.intp]) -> Moments:
    columns = (now.base, now.torso, now.arm, now.width, now.velocity, now.told_torso, now.told_arm, now.told_grip)
    return Moments(*(column[at] for column in columns))
