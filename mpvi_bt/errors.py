"""Every error that mpvi_bt raises on purpose.

MpviError                  exit code 3  a fault of the machine or a backend
├── UserError              exit code 2  bad usage or input: what was given, where, what would be valid
│   ├── UnknownName                     a name that is in no registry, with the nearest match
│   └── FileProblems                    everything wrong with a file, each as file:line:col
├── BackendError           exit code 3  a backend broke or refused
│   └── NoRenderingDevice               pictures were asked for and this machine can draw none
└── NodeError              exit code 3  a behavior raised; names the path of its node in the tree

World failures (a grasp that slipped, a path that is blocked) are not errors: they are FAILURE with a reason code.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


class MpviError(Exception):
    """Base of every error here; `exit_code` is what the command line ends with."""

    exit_code = 3


class UserError(MpviError):
    """Bad usage or input."""

    exit_code = 2


class UnknownName(UserError):
    """A name that is not known, with what would be.

    Attributes:
        kind: What was looked up, such as "task".
        given: The name as given.
        known: Every valid name.
        nearest: The valid name closest to it, or None.
    """

    def __init__(self, kind: str, given: str, known: Iterable[str], where: str = "") -> None:
        self.kind, self.given, self.known = kind, given, sorted(known)
        self.nearest = nearest(given, self.known)
        hint = f" Did you mean {self.nearest!r}?" if self.nearest else ""
        choices = ", ".join(self.known[:12]) + (f", ... ({len(self.known)} in all)" if len(self.known) > 12 else "")
        super().__init__(f"{where + ': ' if where else ''}unknown {kind} {given!r}.{hint} Known: {choices or 'none'}.")


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a file.

    Attributes:
        file: Path as the user gave it.
        line: 1-based line, 0 if the problem has no place in the file.
        column: 1-based column, 0 likewise.
        code: Stable, such as "unknown-key".
        message: What was given and what would be valid.
    """

    file: str
    line: int
    column: int
    code: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        return f"{place}: {self.message} [{self.code}]"


class FileProblems(UserError):
    """All the problems found in one file.

    Attributes:
        problems: In the order of the file; never empty.
    """

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = sorted(problems, key=lambda p: (p.file, p.line, p.column))
        super().__init__("\n".join(map(str, self.problems)))


class BackendError(MpviError):
    """A backend (simulator, policy, detector, checker, planner) broke or refused."""


class NoRenderingDevice(BackendError):
    """A picture was asked for on a machine without a usable Vulkan device."""


class NodeError(MpviError):
    """A behavior raised an exception.

    Attributes:
        path: Names from the root to the node, joined by "/".
    """

    def __init__(self, path: str, cause: BaseException) -> None:
        self.path = path
        super().__init__(f"{path}: {type(cause).__name__}: {cause}")
        self.__cause__ = cause


def nearest(given: str, known: Iterable[str]) -> str | None:
    """The known name closest to `given`, or None if none is near."""
    matches = difflib.get_close_matches(given, list(known), n=1, cutoff=0.55)
    return matches[0] if matches else None
