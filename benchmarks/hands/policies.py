"""The policies that trials are played with, by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mpvi_bt.behaviors.protocols import Policy
from mpvi_bt.manipulation.expert import ExpertPolicy
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
    module = importlib.import_module("mpvi_bt.manipulation.reactive")
    policy: Policy = module.ReactivePolicy(load_skills(), seed)
    return policy


POLICIES: Mapping[str, Maker] = {"expert": Maker(_expert, False), "reactive": Maker(_reactive, True)}
