"""The policies that trials are played with, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mpvi_bt.executive.actions.paced import PacedPolicy
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.hands.learned.policy import RECOVERY, WEIGHTS, LearnedPolicy, StanceRecovery
from mpvi_bt.hands.policies.reactive import ReactivePolicy
from mpvi_bt.house.sim.mistaken import MistakenTruth
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.expert import ExpertPolicy
from mpvi_bt.house.truth.true_scene import Truth
from mpvi_bt.runs.choices.backends import BACKENDS
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy


@dataclass(frozen=True)
class Maker:
    """How a policy is made.

    Attributes:
        make: From a world, a seed, and the standard deviation of errors of position [m], which a policy that sees for
            itself does not need to be told of.
        pictures: Whether it needs a world that can be seen.
    """

    make: Callable[[SimWorld, int, float], Policy]
    pictures: bool


def _expert(world: SimWorld, seed: int, off_m: float) -> Policy:
    truth: Truth = MistakenTruth(world, off_m, seed) if off_m else world
    return ExpertPolicy(truth, load_skills(), seed)


def _reactive(world: SimWorld, seed: int, off_m: float) -> Policy:
    return ReactivePolicy(load_skills(), seed, vocabulary={e.name: e.phrases for e in world.knowledge()})


def _learned(
    world: SimWorld, seed: int, off_m: float, weights: Path = WEIGHTS, recovery: StanceRecovery = RECOVERY
) -> Policy:  # fmt: skip
    vocabulary = {e.name: e.phrases for e in world.knowledge()}
    return LearnedPolicy(load_skills(), SegmentationDetector(vocabulary, least_px=1), seed, weights, recovery)


def _chosen(world: SimWorld, seed: int, off_m: float, given: str) -> Policy:
    vocabulary = {e.name: e.phrases for e in world.knowledge()}
    inputs = PolicyInputs(load_skills(), vocabulary, seed=seed, robot=world.robot.proprioception().robot)
    return PacedPolicy(make_policy(given, inputs))


POLICIES: Mapping[str, Maker] = {
    "expert": Maker(_expert, False),
    "reactive": Maker(_reactive, True),
    "learned": Maker(_learned, True),
    # Ablations of it.
    "learned-one-hypothesis": Maker(partial(_learned, recovery=StanceRecovery(hypotheses=1)), True),
    "learned-one-try": Maker(partial(_learned, recovery=StanceRecovery(tries=0)), True),
    "learned-unrebased": Maker(partial(_learned, recovery=StanceRecovery(rebases=False)), True),
}


def maker_of(given: str) -> Maker:
    """The maker of a policy: of a name, of "learned:FILE.npz", with weights of one's own, or with an address.

    Raises:
        UnknownName: There is none.
    """
    name, _, weights = given.partition(":")
    if weights and name in BACKENDS["policy"] and name not in POLICIES:
        return Maker(partial(_chosen, given=given), True)
    if name not in POLICIES or (weights and name != "learned"):
        raise UnknownName("policy", given, POLICIES)
    return Maker(partial(_learned, weights=Path(weights)), True) if weights else POLICIES[name]
