"""Every case of every skill.

A module of scenes has a table `SKILLS`: skill -> case -> function of a random generator and a set of shapes that draws
a `Trial`. Listing the module here is all that it takes.
"""

from __future__ import annotations

import importlib
import zlib
from collections.abc import Iterable

import numpy as np

from benchmarks.hands.trial import Scene, Shapes, Trial
from mpvi_bt.ground.errors import UnknownName

MODULES = ("pick", "place", "doors", "lids", "two_hands", "tools")


def skills() -> dict[str, dict[str, Scene]]:
    """Skill -> case -> scene, in the order of the modules."""
    out: dict[str, dict[str, Scene]] = {}
    for module in MODULES:
        for skill, cases in importlib.import_module(f"benchmarks.hands.{module}").SKILLS.items():
            out.setdefault(skill, {}).update(cases)
    return out


def choose(skill_names: Iterable[str], case_names: Iterable[str]) -> list[tuple[str, str]]:
    """(skill, case) of every case that is asked for; no names stand for all.

    Raises:
        UnknownName: There is no such skill, or none of the chosen skills has such a case.
    """
    known = skills()
    for name in (chosen := list(skill_names)):
        if name not in known:
            raise UnknownName("skill", name, known)
    pairs = [(skill, case) for skill in chosen or known for case in known[skill]]
    for name in (wanted := list(case_names)):
        if name not in {case for _, case in pairs}:
            raise UnknownName("case", name, {case for _, case in pairs})
    return [(skill, case) for skill, case in pairs if not wanted or case in wanted]


def draw(skill: str, case: str, seed: int, shapes: Shapes) -> Trial:
    """The trial of a seed: the same for every policy and setting."""
    rng = np.random.default_rng([seed, zlib.crc32(f"{skill}/{case}".encode())])
    return skills()[skill][case](rng, shapes)
