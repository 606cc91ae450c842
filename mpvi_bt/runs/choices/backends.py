"""The backends of a run, by kind and name. Loads no backend, so the command line can list them at once.

A backend is chosen as `name`, as `name:address` where it has an address, or as a name or import path of another package
(`runs/choices/plugins.py`). `choose` reads that once; the `Choice` it gives is what is asked and made from then on.
`privileged` backends read simulator truth: every result names those that a run used.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.plugins import OFFERED, PluginPart, asked_for, entry_points, find


@dataclass(frozen=True)
class Backend:
    """One choice.

    Attributes:
        about: One line for a person.
        privileged: Whether it reads simulator truth.
        address: What its address looks like; "" if it has none.
        optional: Whether it may be chosen without its address.
        eyes: By what it sees the pictures of the robot's cameras: "labels", of the renderer; "pixels", colors and depth
            alone; "detector", as the chosen detector does; "" if it looks at none.
        errs: Whether its address says how often it is to err.
        factory: "module:function" that makes it, called with those of the things on offer that it names as parameters;
            "" where a choice needs more than a call.
    """

    about: str
    privileged: bool = False
    address: str = ""
    optional: bool = False
    eyes: Literal["", "labels", "pixels", "detector"] = ""
    errs: bool = False
    factory: str = ""

    @property
    def sees(self) -> bool:
        """Whether it looks through the robot's cameras."""
        return bool(self.eyes)

    def spelled(self, name: str) -> str:
        """How one chooses it: "expert", "openpi:ws://HOST:PORT", "grounding_dino[:MODEL]"."""
        if not self.address:
            return name
        return f"{name}[:{self.address}]" if self.optional else f"{name}:{self.address}"


_SKILLS = re.compile(r"(?P<policy>.+)\[(?P<skills>[\w, ]*)\]", re.DOTALL)  # an address in brackets has colons
NOBODY = "none"  # plans: the policy is told the whole instruction

BACKENDS: Mapping[str, Mapping[str, Backend]] = {
    "planner": {
        "recorded": Backend("the plan on file for the task; symbolic plans a task that has none"),
        "openai": Backend("a language model behind an OpenAI-compatible endpoint", address="MODEL[@URL]"),
        "local": Backend(
            "a language model on this machine, without key or download: SmolLM2 of 135M, which plans badly, or a file",
            address="FILE.gguf",
            optional=True,
        ),
        "symbolic": Backend("a classical planner, from the task's goal and facts: no model, no plan on file"),
        NOBODY: Backend("no plan: the policy gets the whole instruction and the whole time"),
    },
    "map": {
        "prior": Backend("occupancy, rooms and fixtures, derived from the house before the episode"),
        "online": Backend("nothing at first; occupancy is built from depth on the way"),
    },
    "detector": {
        "segmentation": Backend(
            "objects in the camera's label image; the address sets its error rate",
            address="miss=0.1",
            optional=True,
            eyes="labels",
            factory="mpvi_bt.runs.choices.detectors:segmentation",
        ),
        "learned": Backend(
            "a network on the camera's colors and depth; weights of your own, or those that ship",
            address="FILE",
            optional=True,
            eyes="pixels",
            factory="mpvi_bt.runs.choices.detectors:learned",
        ),
        "grounding_dino": Backend(
            "Grounding DINO, by transformers, on the camera's picture",
            address="MODEL",
            optional=True,
            eyes="pixels",
            factory="mpvi_bt.runs.choices.detectors:grounding_dino",
        ),
        "oracle": Backend(
            "the place of every object, from the simulator",
            privileged=True,
            factory="mpvi_bt.runs.choices.detectors:segmentation",
        ),
    },
    "navigator": {
        "grid": Backend("plans paths on the map's grid, and searches for targets without a known place"),
        "nav2": Backend(
            "Nav2 drives to what `grid` says, on robots over ROS 2", factory="mpvi_bt.runs.ros2.nav2_navigator:nav2"
        ),
    },
    "policy": {
        "expert": Backend(
            "scripted skills on true poses: the upper bound",
            privileged=True,
            factory="mpvi_bt.runs.choices.policies:expert",
        ),
        "reactive": Backend(
            "the same skills, on camera pictures", eyes="detector", factory="mpvi_bt.runs.choices.policies:reactive"
        ),
        "learned": Backend(
            "networks, learned from demonstrations; with weights of your own, or those that ship",
            address="FILE.npz",
            optional=True,
            eyes="detector",
            factory="mpvi_bt.runs.choices.policies:learned",
        ),
        "openpi": Backend(
            "a policy server that speaks openpi's protocol",
            address="ws://HOST:PORT",
            eyes="pixels",
            factory="mpvi_bt.runs.choices.policies:openpi",
        ),
        "vla_eval": Backend(
            "a model server of the vla-eval package",
            address="ws://HOST:PORT",
            eyes="pixels",
            factory="mpvi_bt.runs.choices.policies:vla_eval",
        ),
        "groot": Backend(
            "a policy server of GR00T's",
            address="tcp://HOST:PORT",
            eyes="pixels",
            factory="mpvi_bt.runs.choices.policies:groot",
        ),
        "lerobot": Backend(
            "a checkpoint of LeRobot's, in this process or by LeRobot's server",
            address="FOLDER|grpc://HOST:PORT/FOLDER",
            eyes="pixels",
            factory="mpvi_bt.runs.choices.policies:lerobot",
        ),
    },
    "checker": {
        "visual": Backend(
            "judges a criterion by one picture's label image and depth; the address sets its error rates",
            address="fp=0.05,fn=0.1,latency=1",
            optional=True,
            eyes="labels",
            factory="mpvi_bt.runs.choices.checkers:visual",
            errs=True,
        ),
        "learned": Backend(
            "judges as `visual`, by what the network of the detector `learned` sees; the address sets its error rates",
            address="fp=0.05,fn=0.1,latency=1",
            optional=True,
            eyes="pixels",
            factory="mpvi_bt.runs.choices.checkers:learned",
            errs=True,
        ),
        "oracle": Backend(
            "judges a criterion by the simulator's state; the address sets its error rates",
            privileged=True,
            address="fp=0.05,fn=0.1,latency=1",
            optional=True,
            factory="mpvi_bt.runs.choices.checkers:oracle",
            errs=True,
        ),
        "openai": Backend(
            "a vision-language model behind an OpenAI-compatible endpoint",
            address="MODEL[@URL]",
            eyes="pixels",
            factory="mpvi_bt.runs.choices.checkers:openai",
        ),
    },
    "trigger": {
        "proprioceptive": Backend(
            "asks the checker after a grasp, a release, or the end of a motion",
            factory="mpvi_bt.runs.choices.checkers:proprioceptive",
        ),
        "periodic": Backend(
            "asks the checker every STEPS steps", address="STEPS", factory="mpvi_bt.runs.choices.checkers:periodic"
        ),
    },
}


@dataclass(frozen=True)
class Choice:
    """A backend that is chosen.

    Attributes:
        kind: Such as "policy".
        given: As on the command line, such as "openpi:ws://localhost:8000".
        name: Before the colon; of another package's part all that was given.
        address: After it; "" if none is given.
        backend: What is known of it.
        part: Of another package, or None.
        both: The policies of a pair, whose second does what the first has no skill for; None of a single backend.
        only: Skills that the first policy of a pair is to use; None: all that it has.
    """

    kind: str
    given: str
    name: str
    address: str
    backend: Backend
    part: PluginPart | None = None
    both: tuple[Choice, Choice] | None = None
    only: tuple[str, ...] | None = None

    def make(self, **offered: Any) -> Any:
        """The backend itself. A part of another package gets only what `OFFERED` has for its kind.

        Args:
            **offered: What it may be made of; `address` and `given` are offered besides.

        Raises:
            UserError: It cannot be made.
        """
        if self.part is not None:
            return self.part.make(**{name: offered[name] for name in OFFERED[self.kind]})
        module, _, name = self.backend.factory.partition(":")
        factory = getattr(importlib.import_module(module), name)
        offered = {**offered, "address": self.address, "given": self.given}
        return factory(**{p.name: offered[p.name] for p in asked_for(factory)})

    def check(self) -> None:
        """Check a backend of another package. Raises UserError if it is missing or breaks the contract."""
        if self.part is not None:
            self.part.load()
        for one in self.both or ():
            one.check()


def pair(given: str) -> tuple[str, str] | None:
    """Both policies of a choice such as "learned+reactive" or "learned[pick]+reactive"; None of a single one.

    Addresses may have a plus of their own: after one, only a plus before the name of a policy joins two.
    """
    known = BACKENDS["policy"]
    for k, letter in enumerate(given):
        first, second = given[:k], given[k + 1 :]
        name = name_of(_limited(first)[0])
        if letter == "+" and name in known and (":" not in first or name_of(second) in known):
            return first, second
    return None


def _limited(given: str) -> tuple[str, tuple[str, ...] | None]:
    """A policy without the skills in brackets behind it, and these; None of one without."""
    if (found := _SKILLS.fullmatch(given)) is None:
        return given, None
    return found["policy"], tuple(name.strip() for name in found["skills"].split(","))


def name_of(given: str) -> str:
    """What comes before the address of a choice, whether there is such a backend or not."""
    return given.partition(":")[0]


def choose(kind: str, given: str) -> Choice:
    """The backend that is chosen by name, by name and address, or by import path; of policies two, joined by "+".

    Behind the first of two policies, in brackets, may be the skills that it is to use: "learned[pick]+reactive".

    Raises:
        UnknownName: There is none of that name.
        UserError: An address where there is none, or none where there must be one; skills behind no first policy.
    """
    if kind == "policy" and (both := pair(given)) is not None:
        alone, only = _limited(both[0])
        first, second = choose(kind, alone), choose(kind, both[1])
        reads = first.backend.privileged or second.backend.privileged
        sees = first.backend.sees or second.backend.sees
        rest = "what it has no skill for" if only is None else "all other skills"
        backend = Backend(f"{both[0]}; {both[1]} does {rest}", reads, eyes="detector" if sees else "")
        return Choice(kind, given, given, "", backend, both=(first, second), only=only)
    known = BACKENDS[kind]
    if kind == "policy" and (alone := _limited(given)[0]) != given and name_of(alone) in known:
        raise UserError(f"policy {given[:80]}: nobody does the other skills; say who, such as {given[:80]}+reactive.")
    name, _, address = given.partition(":")
    if name not in known:
        if (part := find(kind, given, known)) is not None:
            about = f"{part.path}, of another package"
            looks = kind in ("policy", "checker", "detector")
            return Choice(kind, given, given, "", Backend(about, eyes="labels" if looks else ""), part)
        if kind in OFFERED and (".py" in name or Path(f"{name}.py").is_file()):
            form = f"MODULE:CLASS, such as {Path(name).stem}:My{kind.capitalize()}"
            raise UserError(f"{kind} {given[:80]}: a class in an installed package or a file of this folder is {form}.")
        raise UnknownName(kind, name, (*known, *(entry_points(kind) if kind in OFFERED else ())))
    backend = known[name]
    if backend.address and not address and not (backend.optional and given == name):
        raise UserError(f"{kind} {name} is somewhere else: say where, such as {name}:{backend.address}.")
    if not backend.address and given != name:
        raise UserError(f"{kind} {name} has no address; just say {name}, not {given[:80]!r}.")
    return Choice(kind, given, name, address, backend)


def privileged(chosen: Mapping[str, str]) -> list[str]:
    """Those of the chosen backends (kind to name) that read simulator truth, as "kind:name", sorted."""
    return sorted(f"{kind}:{name}" for kind, name in chosen.items() if choose(kind, name).backend.privileged)


def eyes_of(chosen: Mapping[str, str]) -> dict[str, str]:
    """By what the chosen backends (kind to name) see pictures: kind to "labels" or "pixels", of those that look at any.

    Parts of other packages are taken to read labels, unless their class says `eyes = "pixels"`. A policy that is
    somewhere else sees by pixels; labels are sent to it only where they are rendered for another part. With the
    detector "oracle" policies see by labels.
    """
    choices = {kind: choose(kind, name) for kind, name in chosen.items()}
    detector = _eyes(choices["detector"], "labels") if "detector" in choices else ""
    found = {kind: _eyes(choice, detector or "labels") for kind, choice in choices.items()}
    return {kind: eyes for kind, eyes in found.items() if eyes}


def _eyes(choice: Choice, detector: str) -> str:
    """By what a choice sees, where the detector does by that."""
    if choice.both is not None:
        return max((_eyes(one, detector) for one in choice.both), key=("", "pixels", "labels").index)
    if choice.part is not None and getattr(choice.part.load(), "eyes", "") == "pixels":
        return "pixels"
    return detector if choice.backend.eyes == "detector" else choice.backend.eyes
