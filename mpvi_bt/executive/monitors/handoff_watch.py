"""Takes the figures of one handoff while it lasts, from commands and proprioception, in constant memory."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from mpvi_bt.executive.monitors.handoff import HandFigures, Handoff
from mpvi_bt.executive.monitors.travel import Travel
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.grip import GripWatch
from mpvi_bt.ground.robot.limits import within_limits
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription

_CLIPPED = 1e-3  # [m, rad, m/s]: what is brought within the limits by less is no more than noise
_DIGITS = 3


class HandoffWatch:
    """One handoff under way. It works for any policy: it sees only commands and proprioception.

    Args:
        path: Of the node that hands over.
        prompt: What the policy is told.
        felt: The robot as it stands.
        grip: What its fingers feel; it may have watched the handoff before, too.
        model: Its robot.
        time_s: Simulated time.

    Attributes:
        began_s: When it began, in simulated time.
        clipped: Actions so far that were beyond the robot's limits.
    """

    def __init__(
        self, path: str, prompt: str, felt: Proprioception, grip: GripWatch, model: RobotDescription, time_s: float
    ) -> None:
        self.path, self.prompt, self.began_s, self.clipped = path, prompt, time_s, 0
        self._grip, self._grasped, self._opened = grip, dict(grip.grasped), dict(grip.opened)
        self._model = model
        self._travel, self._told = Travel(felt), Travel(felt)
        self._told_base = felt.base_pose.copy()
        self._steps = 0
        self._empty: Counter[Side] = Counter()
        self._lost: Counter[Side] = Counter()
        self._layout = model.layout
        self._beyond, self._ahead = (np.zeros(self._layout.size, int) for _ in range(2))
        self._chunks = self._longest = self._shortest = 0
        self._wall_s = self._wall_most_s = 0.0

    def answered(self, actions: int, wall_s: float) -> None:
        """Take in an answer of the policy: how many actions, and the wall time that it took."""
        self._shortest = min(self._shortest, actions) if self._chunks else actions
        self._chunks += 1
        self._longest = max(self._longest, actions)
        self._wall_s += wall_s
        self._wall_most_s = max(self._wall_most_s, wall_s)

    def noticed(self, kind: str, side: Side) -> None:
        """Take in what a hand felt: "empty" or "lost"."""
        (self._empty if kind == "empty" else self._lost)[side] += 1

    def acted(self, felt: Proprioception, wanted: Array, action: Array) -> bool:
        """Take in one step.

        Args:
            felt: The robot at this step.
            wanted: (A,) what the policy asked for.
            action: (A,) what is commanded.

        Returns:
            Whether the action had to be brought within the robot's limits.
        """
        self._steps += 1
        self._travel.update(felt)
        self._told.update(self._as_told(felt, wanted))
        off = np.abs(action - wanted) > _CLIPPED
        if not off.any():
            return False
        beyond = np.abs(within_limits(self._model, wanted) - wanted) > _CLIPPED
        self._beyond += off & beyond
        self._ahead += off & ~beyond
        self.clipped += 1
        return True

    def figures(self, time_s: float, stopped_reason: str, said: str = "") -> Handoff:
        """What came of it so far, as if it ended now.

        Args:
            time_s: Simulated time.
            stopped_reason: Why it ends, as of `Handoff`.
            said: The policy's note.
        """
        travel = self._travel
        hands = {
            str(side): HandFigures(
                arm_rad=round(way, _DIGITS),
                grasped=self._grip.grasped[side] - self._grasped[side],
                empty=self._empty[side],
                lost=self._lost[side],
                opened=self._grip.opened[side] - self._opened[side],
            )
            for side, way in travel.arm_rad.items()
        }
        figures = Handoff(self.path, self.prompt, self.began_s, time_s, stopped_reason, said, self._steps)
        return replace(
            figures,
            base_m=round(travel.base_m, _DIGITS),
            base_rad=round(travel.base_rad, _DIGITS),
            torso=round(travel.torso, _DIGITS),
            hands=hands,
            still_s=round(travel.still_s, _DIGITS),
            last_still_s=round(travel.last_still_s, _DIGITS),
            told_still_s=round(self._told.still_s, _DIGITS),
            chunks=self._chunks,
            shortest_chunk=self._shortest,
            longest_chunk=self._longest,
            wall_mean_s=round(self._wall_s / max(self._chunks, 1), 4),
            wall_most_s=round(self._wall_most_s, 4),
            clipped=self.clipped,
            clipped_at=self._clipped_at(),
        )

    def _as_told(self, felt: Proprioception, wanted: Array) -> Proprioception:
        """The robot as if it had done what it was told from the first step on."""
        layout = self._layout
        self._told_base = self._told_base + layout.velocity(wanted) / CONTROL_HZ  # turned wrongly: its length counts
        return replace(
            felt,
            base_pose=self._told_base,
            torso=wanted[layout.torso],
            arm={side: wanted[layout.arm[side]] for side in felt.sides},
            gripper_width={s: (wanted[layout.gripper[s]] + 1.0) / 2 * felt.open_m for s in felt.sides},
        )

    def _clipped_at(self) -> dict[str, int]:
        """What was out of limits and how often, the most frequent first."""
        part = self._layout.part
        found = Counter({f"{part(i)} beyond its limit": int(n) for i, n in enumerate(self._beyond) if n})
        found += Counter({f"{part(i)} too far in one step": int(n) for i, n in enumerate(self._ahead) if n})
        return dict(found.most_common())
