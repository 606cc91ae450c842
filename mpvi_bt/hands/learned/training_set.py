"""Demonstrations as training reads them: every moment of every episode, with the stance that it led to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.learned.demonstration import Demonstration
from mpvi_bt.hands.learned.features import Moments
from mpvi_bt.hands.learned.learned_motions import MOTIONS
from mpvi_bt.hands.learned.mirroring import LAYOUT, SIDE

SHUT = -0.95  # a command below this is a closed hand
_STILL_RAD, _STILL_M_S, _FELT_M_S = 1e-4, 1e-3, 0.02  # less is a pause, in which a scripted demonstrator plans
_PAUSE = 2  # steps of a pause that are kept


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """n moments of all episodes, one after the other; indices are into these.

    Attributes:
        moments: What was felt, and the commands in force.
        stance: (n, 14) base, torso and arm at the end of the closing, or the begin of the opening, that comes next.
        points: (m, 128, 3) samples of points.
        look: (n,) the newest sample; -1: none.
        event: (n,) when that closing or opening is.
        first, last: (n,) the episode's ends.
        episode: (n,) which.
    """

    moments: Moments
    stance: Array
    points: Array
    look: NDArray[np.intp]
    event: NDArray[np.intp]
    first: NDArray[np.intp]
    last: NDArray[np.intp]
    episode: NDArray[np.intp]


def read_frames(folder: Path, skill: str, tell: Callable[[str], None] = lambda line: None) -> TrainingSet:
    """The demonstrations of a skill in `folder`/SKILL/*.npz.

    Args:
        folder: Of demonstrations.
        skill: Of `MOTIONS`.
        tell: Is told which files are left out, and why.

    Raises:
        UserError: There are none, or no such skill.
    """
    if skill not in MOTIONS:
        raise UnknownName("learned skill", skill, MOTIONS)
    moments: list[Moments] = []
    columns: dict[str, list[Any]] = {f.name: [] for f in fields(TrainingSet) if f.name != "moments"}
    n = m = 0
    for path in sorted((folder / skill).glob("*.npz"), key=lambda p: (len(p.stem), p.stem)):
        try:
            shown = Demonstration.load(path)
        except UserError as error:
            tell(f"{path}: left out: {str(error).removeprefix(f'{path}: ')}")
            continue
        kept = _moving(shown)
        now, grip = _moments(shown, kept), shown.action[kept, LAYOUT.gripper[SIDE]]
        events = _events(grip, MOTIONS[skill].opens)
        if not len(events) or not len(shown.points):
            tell(f"{path}: left out, as the hand does nothing in it, or sees nothing")
            continue
        steps = len(kept)
        event = events[np.minimum(np.searchsorted(events, np.arange(steps)), len(events) - 1)]
        stance = np.concatenate([now.base[event], now.told_torso[event], now.told_arm[event]], 1)
        look = shown.look[kept].astype(int)
        new = {
            "stance": stance, "points": shown.points.astype(float), "look": np.where(look >= 0, look + m, -1),
            "event": event + n, "first": np.full(steps, n), "last": np.full(steps, n + steps - 1),
            "episode": np.full(steps, len(moments)),
        }  # fmt: skip
        for name, column in new.items():
            columns[name].append(column)
        moments.append(now)
        n, m = n + steps, m + len(shown.points)
    if not moments:
        raise UserError(f"{folder / skill}: no demonstrations; docs/learned_training.md says how to record some.")
    whole = Moments(*(np.concatenate([getattr(now, f.name) for now in moments]) for f in fields(Moments)))
    rest: dict[str, Any] = {name: np.concatenate(column) for name, column in columns.items()}
    return TrainingSet(whole, **rest)


def _moving(shown: Demonstration) -> NDArray[np.intp]:
    """The steps without pauses but for the first two steps of each."""
    A, velocity = shown.action, shown.velocity
    still = np.zeros(len(A), bool)
    targets = np.abs(np.diff(A[:, 3:], axis=0)).max(1)
    still[1:] = (
        (targets < _STILL_RAD) & (np.abs(A[1:, :3]).max(1) < _STILL_M_S) & (np.abs(velocity[1:]).max(1) < _FELT_M_S)
    )
    kept, pause = [], 0
    for k, rests in enumerate(still):
        pause = pause + 1 if rests else 0
        if pause <= _PAUSE:
            kept.append(k)
    return np.array(kept)


def _moments(shown: Demonstration, kept: NDArray[np.intp]) -> Moments:
    told = shown.action[np.concatenate([kept[:1], kept[:-1]])]  # in force when a frame is seen
    felt = (shown.base, shown.torso, shown.arm, shown.width, shown.velocity)
    base, torso, arm, width, velocity = (column[kept].astype(float) for column in felt)
    told_torso, told_arm, grip = (told[:, at] for at in (LAYOUT.torso, LAYOUT.arm[SIDE], LAYOUT.gripper[SIDE]))
    return Moments(base, torso, arm, width, velocity, told_torso, told_arm, grip)


def _events(grip: Array, opening: bool) -> NDArray[np.intp]:
    """When the hand has been told to close, or begins to open."""
    shut = grip < SHUT
    changes = shut[:-1] & ~shut[1:] if opening else ~shut[:-1] & shut[1:]
    return np.flatnonzero(changes) + 1
