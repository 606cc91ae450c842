"""Backends of other packages: by import path, "my_package.my_module:MyPolicy", or by the name of an entry point.

The entry point groups are `mpvi_bt.planner`, `mpvi_bt.detector`, `mpvi_bt.navigator`, `mpvi_bt.policy`,
`mpvi_bt.checker` and `mpvi_bt.trigger`. What is chosen is called with those of the things on offer that it names as
parameters.
"""

from __future__ import annotations

import importlib.metadata
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.import_paths import IMPORT_PATH, imported, told

# Kind to what its parts may ask for, by the names of parameters.
OFFERED: Mapping[str, tuple[str, ...]] = {
    "planner": ("skills", "grounding", "tell"),
    "detector": ("vocabulary", "seed"),
    "navigator": ("robot", "ours", "seed"),
    "policy": ("skills", "vocabulary", "detector", "seed"),
    "checker": ("vocabulary", "seed"),
    "trigger": ("robot",),
}


@dataclass(frozen=True)
class PluginPart:
    """One that is chosen.

    Attributes:
        kind: Such as "policy".
        given: As on the command line.
        path: "module:name".
        known: Names of the backends of its kind, one of which may have been meant.
    """

    kind: str
    given: str
    path: str
    known: tuple[str, ...] = ()

    def load(self) -> Callable[..., Any]:
        """The class or function, once it is known that it can be called and has the methods of its kind.

        Raises:
            UserError: There is none, or it breaks the contract.
        """
        made: Callable[..., Any] = imported(self.path, self._said, self.known)
        self._arguments(made, dict.fromkeys(OFFERED[self.kind]))
        if isinstance(made, type):
            self._check(made, attributes=False)
        return made

    def make(self, **offered: Any) -> Any:
        """The part itself. Raises UserError as `load`, and if making it fails."""
        make = self.load()
        try:
            part = make(**self._arguments(make, offered))
        except Exception as error:
            raise UserError(f"{self._said}: making it raised {told(error)}") from error
        self._check(part, attributes=True)
        return part

    @property
    def _said(self) -> str:
        return f"{self.kind} {self.given}"

    def _arguments(self, make: Callable[..., Any], offered: Mapping[str, Any]) -> dict[str, Any]:
        """The offered arguments that `make` takes. Raises UserError if it requires others."""
        named = asked_for(make)
        if lacking := [p.name for p in named if p.default is p.empty and p.name not in offered]:
            given = ", ".join(OFFERED[self.kind])
            raise UserError(f"{self._said}: wants {lacking[0]!r} to be made; a {self.kind} is offered: {given}.")
        return {p.name: offered[p.name] for p in named if p.name in offered}

    def _check(self, part: Any, attributes: bool) -> None:
        """Raise UserError if it lacks what the protocol of its kind has."""
        protocol = _protocol(self.kind)
        methods = [name for name, member in vars(protocol).items() if inspect.isfunction(member) and name[0] != "_"]
        fields = [name for name, member in vars(protocol).items() if isinstance(member, property)]
        fields += [name for name in vars(protocol).get("__annotations__", {}) if name[0] != "_"]
        lacks = [f"{name}()" for name in methods if not callable(getattr(part, name, None))]
        lacks += [name for name in fields if attributes and not hasattr(part, name)]
        if lacks:
            about = f"`{protocol.__module__}.{protocol.__name__}`"
            raise UserError(f"{self._said}: a {self.kind} has {', '.join(lacks)}, and this has not; see {about}.")


def asked_for(make: Callable[..., Any]) -> list[inspect.Parameter]:
    """Named parameters of a class or function; [] if it has no signature."""
    try:
        wanted = inspect.signature(make).parameters.values()
    except ValueError:
        return []
    return [p for p in wanted if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]


def find(kind: str, given: str, known: Iterable[str] = ()) -> PluginPart | None:
    """The part of another package that a choice names, by import path or entry point; None: there is none.

    `known` are the backends of that kind, for messages.
    """
    if kind not in OFFERED:
        return None
    if IMPORT_PATH.fullmatch(given):
        return PluginPart(kind, given, given, tuple(known))
    path = entry_points(kind).get(given)
    return PluginPart(kind, given, path) if path else None


def entry_points(kind: str) -> dict[str, str]:
    """Name to import path of the parts that installed packages have."""
    return {point.name: point.value for point in importlib.metadata.entry_points(group=f"mpvi_bt.{kind}")}


def _protocol(kind: str) -> type:
    from mpvi_bt.executive.plan.planners import Planner
    from mpvi_bt.finding.perception.detector import Detector
    from mpvi_bt.ground.protocols import Checker, Navigator, Policy, Triggers

    protocols: dict[str, type] = {
        "planner": Planner,
        "detector": Detector,
        "navigator": Navigator,
        "policy": Policy,
        "checker": Checker,
        "trigger": Triggers,
    }
    return protocols[kind]
