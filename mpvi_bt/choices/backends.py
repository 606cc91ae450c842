"""The backends that a run can choose, by kind and name. Light, so that the command line can list them at once.

A backend is chosen as `name` or, where it is somewhere else, as `name:address`. `choices/policies.py` and
`episode/episode.py` make what is chosen. What is not among these may be of another package: `choices/plugins.py`.
`privileged` backends read simulator truth: every result names those that a run used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.choices.plugins import OFFERED, entry_points, find
from mpvi_bt.errors import UnknownName, UserError


@dataclass(frozen=True)
class Backend:
    """One choice.

    Attributes:
        about: One line for a person.
        privileged: Whether it reads simulator truth.
        address: What its address looks like; "" if it has none.
        optional: Whether it may be chosen without its address.
        sees: Whether it looks through the robot's cameras.
    """

    about: str
    privileged: bool = False
    address: str = ""
    optional: bool = False
    sees: bool = False

    def spelled(self, name: str) -> str:
        """How one chooses it: "expert", "openpi:ws://HOST:PORT", "grounding_dino[:MODEL]"."""
        if not self.address:
            return name
        return f"{name}[:{self.address}]" if self.optional else f"{name}:{self.address}"


NOBODY = "none"  # plans: the policy is told the whole instruction

BACKENDS: Mapping[str, Mapping[str, Backend]] = {
    "planner": {
        "recorded": Backend("the plan on file for the task"),
        "openai": Backend("a language model behind an OpenAI-compatible endpoint", address="MODEL[@URL]"),
        "local": Backend(
            "a language model on this machine, without key or download: SmolLM2 of 135M, which plans badly, or a file",
            address="FILE.gguf",
            optional=True,
        ),
        NOBODY: Backend("the policy is told the whole instruction, and has the whole time"),
    },
    "map": {
        "prior": Backend("occupancy, rooms and fixtures, derived from the house before the episode"),
        "online": Backend("nothing at first; occupancy is built from depth on the way"),
    },
    "detector": {
        "segmentation": Backend(
            "what the camera's label image shows; it errs as its address says",
            address="miss=0.1",
            optional=True,
            sees=True,
        ),
        "grounding_dino": Backend(
            "Grounding DINO, by transformers, on the camera's picture", address="MODEL", optional=True, sees=True
        ),
        "oracle": Backend("where every object is, from the simulator", privileged=True),
    },
    "policy": {
        "expert": Backend("scripted skills on true poses: the upper bound", privileged=True),
        "reactive": Backend("the same skills on what the cameras show", sees=True),
        "learned": Backend(
            "networks, learned from demonstrations; with weights of your own, or those that ship",
            address="FILE.npz",
            optional=True,
            sees=True,
        ),
        "openpi": Backend("a policy server that speaks openpi's protocol", address="ws://HOST:PORT", sees=True),
        "vla_eval": Backend("a model server of the vla-eval package", address="ws://HOST:PORT", sees=True),
    },
    "checker": {
        "visual": Backend(
            "judges a criterion by what one camera image shows; it errs as its address says",
            address="fp=0.05,fn=0.1,latency=1",
            optional=True,
            sees=True,
        ),
        "oracle": Backend(
            "judges a criterion by the simulator's state; it errs as its address says",
            privileged=True,
            address="fp=0.05,fn=0.1,latency=1",
            optional=True,
        ),
        "openai": Backend(
            "a language model that sees, behind an OpenAI-compatible endpoint", address="MODEL[@URL]", sees=True
        ),
    },
    "trigger": {
        "proprioceptive": Backend("asks the checker when a hand or an arm has just ended something"),
        "periodic": Backend("asks the checker every so many steps", address="STEPS"),
    },
}


def split(given: str) -> tuple[str, str]:
    """Name and address of a choice such as "openpi:ws://localhost:8000"; the address is "" where none is given."""
    name, _, address = given.partition(":")
    return name, address


def pair(given: str) -> tuple[str, str] | None:
    """Both policies of a choice such as "learned+reactive"; None of a single one.

    Addresses may have a plus of their own: after one, only a plus before the name of a policy joins two.
    """
    known = BACKENDS["policy"]
    for k, letter in enumerate(given):
        first, second = given[:k], given[k + 1 :]
        if letter == "+" and split(first)[0] in known and (":" not in first or split(second)[0] in known):
            return first, second
    return None


def choose(kind: str, given: str) -> Backend:
    """The backend that is chosen by `name` or `name:address`; of policies two may be, joined by "+".

    Raises:
        UnknownName: There is none of that name.
        UserError: An address where there is none, or none where there must be one.
    """
    if kind == "policy" and (both := pair(given)) is not None:
        first, second = (choose(kind, one) for one in both)
        return Backend(f"{both[0]}; {both[1]} does what it has no skill for", first.privileged or second.privileged,
                       sees=first.sees or second.sees)  # fmt: skip
    known = BACKENDS[kind]
    name, address = split(given)
    if name not in known:
        if (part := find(kind, given)) is not None:
            return Backend(f"{part.path}, of another package", sees=kind in ("policy", "checker", "detector"))
        raise UnknownName(kind, name, (*known, *(entry_points(kind) if kind in OFFERED else ())))
    backend = known[name]
    if backend.address and not address and not (backend.optional and given == name):
        raise UserError(f"{kind} {name} is somewhere else: say where, such as {name}:{backend.address}.")
    if not backend.address and given != name:
        raise UserError(f"{kind} {name} has no address; just say {name}, not {given[:80]!r}.")
    return backend


def privileged(chosen: Mapping[str, str]) -> list[str]:
    """Those of the chosen backends (kind to name) that read simulator truth, as "kind:name", sorted."""
    return sorted(f"{kind}:{name}" for kind, name in chosen.items() if choose(kind, name).privileged)
