"""The policies that trials are played with, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mpvi_bt.manipulation.policies.expert import ExpertPolicy
from mpvi_bt.manipulation.policies.reactive import ReactivePolicy
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.protocols import Policy
from mpvi_bt.scene.true_scene import Truth
from mpvi_bt.sim.mistaken import MistakenTruth
from mpvi_bt.sim.world import World


@dataclass(frozen=True)
class Maker:
    """How a policy is made.

    Attributes:
        make: From a world, a seed, and the standard deviation of errors of position [m], which a policy that sees for
            itself does not need to be told of.
        pictures: Whether it needs a world that can be seen.
    """

    make: Callable[[World, int, float], Policy]
    pictures: bool


def _expert(world: World, seed: int, off_m: float) -> Policy:
    truth: Truth = MistakenTruth(world, off_m, seed) if off_m else world
    return ExpertPolicy(truth, load_skills(), seed)


def _reactive(world: World, seed: int, off_m: float) -> Policy:
    return ReactivePolicy(load_skills(), seed, vocabulary={e.name: e.phrases for e in world.knowledge()})


POLICIES: Mapping[str, Maker] = {"expert": Maker(_expert, False), "reactive": Maker(_reactive, True)}
