"""One handoff: its figures, and why it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pydantic import ConfigDict

from mpvi_bt.ground.marked_yaml import Amount, Count

# Why a handoff ended. All other reasons are the reason codes of the node that ended it, such as "timeout" or "alarm",
# or the ending of the run, such as "time_limit".
COMPLETE = "complete"  # the checker said yes
POLICY_DONE = "policy_done"  # the policy takes its prompt for done, and nobody has confirmed it
POLICY_GAVE_UP = "policy_gave_up"
NEW_PROMPT = "new_prompt"  # the prompt changed under way, and the policy began anew
CUT_OFF = "cut_off"  # another branch of the tree took over
INTERRUPTED = "interrupted"  # the run was stopped

# So long without motion is standing still. Our choice: slower than 0.025 rad/s, below the deadband of the signals.
STILL_S = 2.0

DONE = "done"  # how the note of a policy ends that takes its prompt for done


@dataclass(frozen=True)
class HandFigures:
    """One arm and its hand.

    Attributes:
        arm_rad: Way of the arm [rad]: at each move the joint that turned most.
        grasped, empty: How often the hand closed on something, and on nothing.
        lost: How often what it held was gone.
        opened: How often it was told to open after it had been told to close.
    """

    arm_rad: Amount = 0.0
    grasped: Count = 0
    empty: Count = 0
    lost: Count = 0
    opened: Count = 0

    @property
    def gripped(self) -> int:
        """Events of its fingers."""
        return self.grasped + self.empty + self.lost + self.opened


@dataclass(frozen=True)
class Handoff:
    """The figures of one handoff. Times are simulated, but for those that begin with `wall`.

    Attributes:
        path: Of the node that handed over.
        prompt: What the policy was told.
        began_s, ended_s: When.
        stopped_reason: Why it ended: "complete", "policy_done", "policy_gave_up", "new_prompt", "cut_off",
            "interrupted", the reason code of the node that ended it, or the run's ending.
        said: The policy's last note.
        steps: Actions that were carried out.
        base_m, base_rad: Way and turning of the base.
        torso: Way of the torso's joints [m or rad].
        hands: By side.
        still_s: Time in stretches of 2 s or longer without any motion of the robot.
        last_still_s: How long nothing had moved at the end.
        told_still_s: Likewise, time in which the commands asked for no motion.
        chunks: Answers of the policy.
        shortest_chunk, longest_chunk: Actions of an answer.
        wall_mean_s, wall_most_s: Wall time of an answer: on average, and of the slowest. Handoffs that differ in these
            alone are equal.
        waited_s: Time in which the robot held for want of an action, of a policy that was made late.
        clipped: Actions that were brought within the robot's limits.
        clipped_at: So many of them by what was out of limits, such as "right arm joint 4 beyond its limit".
        judged: Whether a completion checker worked beside the policy.
        asked: Questions that the checker answered.
        noes: Answers by no.
        unanswered: Questions that got neither yes nor no.
        last_no: The criterion and reason of the last no, or "".
        false_noes: Noes of which the simulator's state says that they were wrong; null where that is not known.
        cause: The likely cause in a sentence, in results; traces leave it to `monitors.causes`.
    """

    __pydantic_config__ = ConfigDict(allow_inf_nan=False)

    path: str
    prompt: str
    began_s: Amount
    ended_s: Amount
    stopped_reason: str
    said: str = ""
    steps: Count = 0
    base_m: Amount = 0.0
    base_rad: Amount = 0.0
    torso: Amount = 0.0
    hands: Mapping[str, HandFigures] = field(default_factory=dict)
    still_s: Amount = 0.0
    last_still_s: Amount = 0.0
    told_still_s: Amount = 0.0
    chunks: Count = 0
    shortest_chunk: Count = 0
    longest_chunk: Count = 0
    wall_mean_s: Amount = field(default=0.0, compare=False)
    wall_most_s: Amount = field(default=0.0, compare=False)
    waited_s: Amount = 0.0
    clipped: Count = 0
    clipped_at: Mapping[str, Count] = field(default_factory=dict)
    judged: bool = False
    asked: Count = 0
    noes: Count = 0
    unanswered: Count = 0
    last_no: str = ""
    false_noes: Count | None = None
    cause: str = ""

    @property
    def length_s(self) -> float:
        """How long it lasted."""
        return self.ended_s - self.began_s

    @property
    def complete(self) -> bool:
        """Whether the checker ended it by a yes."""
        return self.stopped_reason == COMPLETE


def says_done(note: str) -> bool:
    """Whether a policy's note is that its prompt is done, such as "2 of 2, turn on the radio: done"."""
    return note == DONE or note.endswith(f": {DONE}")
