"""The policies that trials are played with, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mpvi_bt.behaviors.protocols import Policy
from mpvi_bt.manipulation.expert import ExpertPolicy
from mpvi_bt.manipulation.reactive import ReactivePolicy
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.sim.world import World


@dataclass(frozen=True)
class Maker:
    """How a policy is made.

    Attributes:
        make: From a world and a seed.
        pictures: Whether it needs a world that can be seen.
    """

    make: Callable[[World, int], Policy]
    pictures: bool


def _expert(world: World, seed: int) -> Policy:
    return ExpertPolicy(world, load_skills(), seed)


def _reactive(world: World, seed: int) -> Policy:
    # What labels are called stands for what an open-vocabulary detector knows; nothing else of the world goes in.
    vocabulary = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    return ReactivePolicy(load_skills(), seed, vocabulary=vocabulary)


POLICIES: Mapping[str, Maker] = {"expert": Maker(_expert, False), "reactive": Maker(_reactive, True)}
