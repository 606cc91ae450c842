"""The learned policy: what cameras show and the robot feels in, chunks of actions out, by trained weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import Skill, SkillCall
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import NO_SKILL
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, EMPTY_M, SIDES, CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robots import layout_of, model_named
from mpvi_bt.hands.learned.acting import CHUNK, ahead, chunk, propose, rebased, there
from mpvi_bt.hands.learned.demonstration import HEAD_TILTS_RAD, TILT_STEPS
from mpvi_bt.hands.learned.learned_hand import LearnedHand
from mpvi_bt.hands.learned.learned_motions import MOTIONS, LearnedMotion
from mpvi_bt.hands.learned.network import HYPOTHESES, Networks, Weights
from mpvi_bt.hands.learned.points import PointMemory

WEIGHTS = Path(__file__).parent / "weights.npz"
# All our choice.
_EMPTY_CHUNKS = 3  # that a closed hand is empty before it is opened
_OPENING = 15  # steps
_CLOSED = -0.9  # a gripper's command, of -1 to 1, that means closed
_STUCK_CHUNKS = 10  # without a move: 3 s
_STUCK_M = 0.02  # what has moved less has not moved
_SHOWN_CHUNKS = 40  # that nobody says it is complete: 12 s, in which a checker that is asked every 10 s is asked
_DONE, _DONE_CHUNKS, _DONE_M = 0.9, 3, 0.07  # progress, for so long, so far from where it closed or let go


@dataclass(frozen=True)
class StanceRecovery:
    """What is done about a stance that does not work out. The benchmark of hands leaves out one of these at a time."""

    hypotheses: int = HYPOTHESES  # most likely hypotheses of the proposer that are considered
    tries: int = 5  # closings on nothing before another stance is proposed; with 0, none for a stuck hand either
    rebases: bool = True  # whether the stance is solved anew if the base has come to rest a little off


RECOVERY = StanceRecovery()


class LearnedPolicy:
    """`mpvi_bt.ground.protocols.Policy` of weights that `mpvi train learned` made.

    Attributes:
        note: What it is doing or why it gave up, for a person.
        ended: Whether it thinks that it has done its prompt, or has given up.
        gave_up: Whether it does no more about its prompt.
        progress: How far along it takes itself to be, 0 to 1; it reads high on an empty grasp, too.
        attempts: Stances that it proposed.
        rate_hz: An action a control step.
    """

    name = "learned"
    rate_hz = float(CONTROL_HZ)

    def __init__(
        self, skills: Mapping[str, Skill], detector: Detector, seed: int = 0, weights: Path = WEIGHTS,
        recovery: StanceRecovery = RECOVERY,
    ) -> None:  # fmt: skip
        """Act by a file of weights, seeing through `detector`.

        Raises:
            UserError: The weights cannot be read, or are of another version.
        """
        self._skills, self._detector, self._seed, self._recovery = skills, detector, seed, recovery
        self._weights = Weights.load(weights)
        self._prompts = 0
        self.reset()

    @property
    def cameras(self) -> tuple[str, ...]:
        """The head's, and that of the hand at work."""
        return self._wanted

    def reset(self) -> None:
        """Forget the prompt."""
        self._prompt: str | None = None
        self._wanted: tuple[str, ...] = ("head",)
        self._chunks: Iterator[Array] = iter(())
        self._told: Array | None = None  # the last command
        self.note, self.ended, self.gave_up, self.progress, self.attempts = "", False, False, 0.0, 0

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (h, A).

        Raises:
            DetectorError: The detector failed.
        """
        self._felt: Proprioception = observation["proprioception"]
        self._images: Mapping[str, CameraImage] = observation["images"]
        if observation["prompt"] != self._prompt:
            self.reset()
            self._prompt = str(observation["prompt"])
            self._prompts += 1
            self._chunks = self._performed(self._prompt)
        actions = next(self._chunks, None)
        if actions is None:
            self.ended, self.gave_up, self._wanted = True, True, ()
            if self._told is None:
                self._told = LearnedHand(SIDES[1], self._felt).still(1)[-1]
            layout_of(self._felt).set_velocity(self._told, 0.0)
            actions = self._told[None].copy()
        self._told = actions[-1].copy()
        return actions

    def can(self, prompt: str) -> SkillCall | None:
        """The one skill that a prompt asks for, if it was learned."""
        said = clauses(prompt, self._skills)
        call = match(said[0], self._skills) if len(said) == 1 else None
        known = self._weights.skills.keys() & MOTIONS
        return call if call is not None and call.target is not None and call.motion in known else None

    def _performed(self, prompt: str) -> Iterator[Array]:
        """Everything that it does about a prompt; it ends once it has given up."""
        if self._felt.robot != self._weights.robot:
            self.note = f"{NO_SKILL}: these weights move the robot {self._weights.robot}, not {self._felt.robot}"
            return
        call = self.can(prompt)
        if call is None or (phrase := call.target) is None:
            known = ", ".join(self._weights.skills)
            self.note = f"{NO_SKILL}: {shown(prompt)} is not one of {known}"
            return
        motion = MOTIONS[call.motion]
        rng = np.random.default_rng([self._seed, self._prompts])
        memory = PointMemory(self._detector, phrase, rng)
        yield from self._found(memory, motion)
        if not memory.seen:
            self.note = f"not_found: {shown(phrase)}"
            return
        side = self._holder(call) if motion.opens else self._free(call, memory)
        if side is None:
            return
        if memory.spread_m > motion.most_m:
            self.note = f"{NO_SKILL}: the {phrase} is larger than what it was trained on"
            return
        self._wanted = ("head", side)
        self.note = f"{call.motion} {phrase}, {side} hand"
        net = self._weights.skills[call.motion]
        yield from self._acted(net, motion, LearnedHand(side, self._felt), memory, phrase)

    def _found(self, memory: PointMemory, motion: LearnedMotion) -> Iterator[Array]:
        """Look; where the target is not in view, tilt the head and look again."""
        self.note = "looking"
        if self._looked(memory, motion):
            return
        body = LearnedHand(SIDES[1], self._felt)
        for tilt in HEAD_TILTS_RAD:
            rows = body.still(TILT_STEPS)
            rows[:, body.layout.torso.stop - 1] = tilt
            body.action = rows[-1].copy()
            yield rows
            if self._looked(memory, motion):
                return

    def _looked(self, memory: PointMemory, motion: LearnedMotion) -> bool:
        felt, robot = self._felt, model_named(self._felt.robot)
        T_world_base = kin.base(felt.base_pose)
        holding = [side for side in felt.sides if felt.holds(side) and not motion.opens]
        carried = [matmul(T_world_base, robot.tcp(felt.torso, felt.arm[s], s))[:3, 3] for s in holding]
        memory.look(*(self._images[camera] for camera in self._wanted if camera in self._images), carried=carried)
        return memory.seen

    def _holder(self, call: SkillCall) -> Side | None:
        """The hand that holds the payload, or None: then the note says why."""
        said = call.arguments.get("hand")
        full: list[Side] = [side for side in self._felt.sides if self._felt.holds(side) and said in (side, None)]
        if len(full) == 1:
            return full[0]
        self.note = f"{NO_SKILL}: both hands hold something" if full else "not_held: no hand holds a payload"
        return None

    def _free(self, call: SkillCall, memory: PointMemory) -> Side | None:
        """A free hand: the one that is said, else the one on the target's side if both are; None: there is none."""
        said = call.arguments.get("hand")
        free: list[Side] = [
            side for side in SIDES if not self._felt.holds(side) and (said not in SIDES or side == said)
        ]
        if not free:
            self.note = f"{NO_SKILL}: to set down what is in the hand"
            return None
        if len(free) < 2:
            return free[0]
        at = matmul(kin.inverse(kin.base(self._felt.base_pose)), np.append(memory.middle, 1.0))
        return "left" if at[1] > 0 else "right"

    def _acted(
        self, net: Networks, motion: LearnedMotion, hand: LearnedHand, memory: PointMemory, target: str
    ) -> Iterator[Array]:
        stance: Array | None = None
        empty = tries = done = 0
        worked: Array | None = None  # where the hand closed on the payload, or let go of it
        rest, begun = _HandRest(), hand.now().base
        said = self.note
        while True:
            hand.feel(self._felt)
            now = hand.now()
            at = now.hands_in_world[0, :3, 3]
            grip, holds = now.told_grip[0], self._felt.holds(hand.side)
            closed = grip < _CLOSED
            if motion.opens:
                let_go = not (holds or closed)
                worked = at if worked is None and let_go else worked  # a hand that closes again has still let go
            elif not holds:
                worked = None
            elif worked is None:
                worked = at
            away = worked is not None and norm(at - worked) >= _DONE_M
            done = done + 1 if away and self.progress >= _DONE else 0
            self.ended = done >= _DONE_CHUNKS
            self.note = "done" if self.ended else said
            if done >= _DONE_CHUNKS + _SHOWN_CHUNKS:
                return
            if self.ended:
                yield hand.still(CHUNK)
                continue
            if worked is None and closed and now.width[0] < EMPTY_M:
                empty += 1
            if empty >= _EMPTY_CHUNKS and motion.opens:
                self.note = "dropped: the hand is empty on the way"
                return
            if empty >= _EMPTY_CHUNKS and tries < self._recovery.tries:  # closed on nothing: open, and think again
                empty, tries, stance = 0, tries + 1, None
                yield hand.still(_OPENING, 1.0)
                continue
            if empty >= _EMPTY_CHUNKS:
                self.note = f"missed: closed on nothing {tries + 1} times"
                return
            if motion.sees(grip):
                self._looked(memory, motion)
            points = hand.points(memory.sample())
            if self._recovery.tries and rest.stuck(at) and closed == motion.opens:
                if stance is not None and motion.opens and there(stance, at):  # and it does not open
                    yield hand.still(_OPENING, 1.0)
                    continue
                stance, tries = None, tries + 1
            if stance is None:
                self.attempts += 1
                stance = propose(net, now, begun, points, self._recovery.hypotheses, tries, here=tries > 0)
            if stance is None and tries:
                stance = propose(net, now, begun, points, self._recovery.hypotheses, tries, here=False)
            if stance is None:
                reason = "out_of_reach" if tries else NO_SKILL
                self.note = f"{reason}: no hand pose that it proposes for the {target}"
                return
            stance = rebased(now, stance) if self._recovery.rebases else stance
            steps, self.progress = chunk(net, now, ahead(now, stance), points, motion.ahead(grip), motion.opens)
            yield np.array([hand.command(*step) for step in steps])


class _HandRest:
    """Notices that a hand does not move."""

    def __init__(self) -> None:
        self._at: Array | None = None
        self._chunks = 0

    def stuck(self, at: Array) -> bool:
        """Whether the hand, at (3,) in the world, has not moved for long; then it begins anew."""
        if self._at is None or norm(at - self._at) > _STUCK_M:
            self._at, self._chunks = at, 0
        self._chunks += 1
        if self._chunks < _STUCK_CHUNKS:
            return False
        self._chunks = 0
        return True
