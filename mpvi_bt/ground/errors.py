"""Every error that mpvi_bt raises on purpose.

    MpviError                  exit code 3  a fault of the machine or a backend
    ├── UserError              exit code 2  bad usage or input: what was given, where, what would be valid
    │   ├── UnknownName                     a name that is in no registry, with the nearest match
    │   └── FileProblems                    everything wrong with a file, each as file:line:col
    ├── BackendError           exit code 3  a backend broke or refused
    │   ├── DiskFull                        there is no room for what is to be written
    │   ├── NoRenderingDevice               pictures were asked for and this machine can draw none
    │   ├── PolicyError                     a policy's server is away or answers what no policy may; has a reason code
    │   ├── DetectorError                   a detector broke, hangs or answers what no detector may; has a reason code
    │   ├── RobotError                      a robot over ROS 2 is silent, wrong, or commanded by others; has a code
    │   ├── ModelError                      a language model is away, refuses or gives no answer; has a reason code
    │   └── BadMessage                      bytes from elsewhere are not what the protocol says
    └── NodeError              exit code 3  a behavior raised; names the path of its node in the tree

World failures (a grasp that slipped, a path that is blocked) are not errors: they are FAILURE with a reason code.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

_OURS = Path(__file__).absolute().parents[1]


class MpviError(Exception):
    """Base of every error here; `exit_code` is what the command line ends with. No line of its message is long."""

    exit_code = 3

    def __init__(self, message: str = "") -> None:
        super().__init__(bounded(message))


class UserError(MpviError):
    """Bad usage or input."""

    exit_code = 2


class NoModel(UserError):
    """A robot is known by its file alone: what plans with closed forms of its arms cannot move it."""


class UnknownName(UserError):
    """An unknown name; the message lists valid ones.

    Attributes:
        kind: What was looked up, such as "task".
        given: The name as given.
        known: Every valid name.
        nearest: The valid name closest to it, or None.
    """

    def __init__(self, kind: str, given: str, known: Iterable[str], where: str = "") -> None:
        self.kind, self.given, self.known = kind, given, sorted(known)
        self.nearest = nearest(given, self.known)
        hint = did_you_mean(self.nearest, self.known)
        super().__init__(f"{where + ': ' if where else ''}unknown {kind} {shown(given)}.{hint}")


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a file.

    Attributes:
        file: Path as the user gave it.
        line: 1-based line, 0 if the problem has no place in the file.
        column: 1-based column, 0 likewise.
        code: Stable, such as "unknown-key"; docs/codes.md says how each is mended.
        message: What was given and what would be valid.
        severity: "error"; "warning": the file can be used, but hardly does what was meant; or "note": it is as it
            should be, and there is something to know about it.
        nearest: The valid name closest to what was given, if a name was.
        known: Every valid name, if a name was given.
        pointer: Where in the file's data it is, as a JSON pointer such as "/root/children/0/navigate"; "" is all of it.
    """

    file: str
    line: int
    column: int
    code: str
    message: str
    severity: Literal["error", "warning", "note"] = "error"
    nearest: str | None = None
    known: tuple[str, ...] = ()
    pointer: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", bounded(self.message))

    @classmethod
    def unknown(
        cls,
        file: str,
        place: tuple[int, int],
        kind: str,
        given: str,
        known: Iterable[str],
        whose: str = "",
        **more: Any,
    ) -> Problem:
        """The problem of an unknown name, such as a room missing from the house. `whose` is added, as in " of it"."""
        names = sorted(known)
        near = nearest(given, names)
        message = f"unknown {kind} {shown(given)}{whose}.{did_you_mean(near, names)}"
        code = f"unknown-{kind.replace(' ', '-')}"
        return cls(file, *place, code, message, nearest=near, known=tuple(names), **more)

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        kind = "" if self.severity == "error" else f"{self.severity}: "
        return f"{place}: {kind}{self.message} [{self.code}]"


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


class DiskFull(BackendError):
    """No space left on the disk, or in the user's quota."""


class NoRenderingDevice(BackendError):
    """A picture was asked for on a machine without a usable Vulkan device."""


class NotInDryRun(BackendError):
    """A dry run was asked for what it does without, such as a robot."""


class CodedError(BackendError):
    """A backend failed in a way that has a code.

    Attributes:
        reason: Stable code, such as "server_absent".
    """

    def __init__(self, reason: str, message: str) -> None:
        self.reason = reason
        super().__init__(message)


class PolicyError(CodedError):
    """The backend of a policy failed, not the policy: its server is away, refuses, or answers what no policy may.

    docs/policy_servers.md lists the codes, such as "server_absent".
    """


class DetectorError(CodedError):
    """A detector broke, hangs, cannot be loaded, or answers what no detector may.

    docs/detectors.md lists the codes, such as "bad_box".
    """


class RobotError(CodedError):
    """A robot over ROS 2 is silent, says what cannot be, or is commanded by another node too: it was halted.

    docs/ros2.md lists the codes, such as "silent".
    """


class ModelError(CodedError):
    """A language model gave no answer that can be one, or may not be asked.

    docs/language.md lists the codes, such as "endpoint_down".

    Attributes:
        latency_s: How long it took to come to this.
        tokens: That were spent on it.
    """

    def __init__(self, reason: str, message: str, latency_s: float = 0.0, tokens: int = 0) -> None:
        super().__init__(reason, message)
        self.latency_s, self.tokens = latency_s, tokens


class BadMessage(BackendError):
    """Received bytes do not follow the protocol."""


class NodeError(MpviError):
    """A behavior raised an exception.

    Attributes:
        path: Names from the root to the node, joined by "/".
        message: What was raised, such as "ValueError: no such cup".
        place: Where in the code of the behavior's author, such as "waving.py:12"; "" if none of it was at work.
    """

    def __init__(self, path: str, cause: BaseException) -> None:
        self.path, self.message, self.place = path, f"{type(cause).__name__}: {cause}", _place(cause)
        super().__init__(f"{path}: {self.message}" + (f", at {self.place}" if self.place else ""))
        self.__cause__ = cause


def _place(error: BaseException) -> str:
    """The innermost line of the author's code: below the folder of the first that is neither ours nor py_trees'."""
    frames = []
    trace = error.__traceback__
    while trace is not None:
        file = Path(trace.tb_frame.f_code.co_filename).absolute()
        if _OURS not in file.parents and "py_trees" not in file.parts:
            frames.append((file, trace.tb_lineno))
        trace = trace.tb_next
    if not frames:
        return ""
    home = frames[0][0].parent
    file, line = [frame for frame in frames if home in frame[0].parents][-1]
    here = Path.cwd()
    return f"{file.relative_to(here) if here in file.parents else file}:{line}"


def nearest(given: str, known: Iterable[str]) -> str | None:
    """The known name closest to `given`, or None if none is near."""
    if len(given) > 300:  # no name is; comparing would take long
        return None
    matches = difflib.get_close_matches(given, list(known), n=1, cutoff=0.55)
    return matches[0] if matches else None


_LONGEST = 2000  # Our choice: a screen full


def bounded(text: str, longest: int = _LONGEST) -> str:
    """The message with long lines shortened: their middle is left out."""
    if len(text) <= longest:
        return text
    head, tail = 3 * longest // 4, longest // 4
    return "\n".join(
        line
        if len(line) <= longest
        else f"{line[:head]} ... ({len(line) - head - tail} characters left out) ... {line[-tail:]}"
        for line in text.split("\n")
    )


_BESIDE = 40  # characters


def did_you_mean(near: str | None, known: Sequence[str], most: int = 12) -> str:
    """The end of a message about a name that is not known: the nearest one, and the first `most` of all.

    A long list is left out beside the nearest one, so that the message fits a line.
    """
    hint = f" Did you mean {near!r}?" if near else ""
    if near and len(", ".join(known)) > _BESIDE:
        return hint
    more = f", ... ({len(known)} in all)" if len(known) > most else ""
    return f"{hint} Known: {', '.join(known[:most]) or 'none'}{more}."


_LIKE_YOU = ("uni", "use", "usu", "ute", "eu", "one")  # how words begin that are spoken with a consonant


def with_article(words: str) -> str:
    """Words with their article, such as "an object", "a unit", "an 'int'"."""
    plain = words.lstrip("'\"").lower()
    return f"{'an' if plain[:1] in tuple('aeiou') and not plain.startswith(_LIKE_YOU) else 'a'} {words}"


def shown(value: Any, longest: int = 60) -> str:
    """A value as a message quotes it: on one line, and no longer than so many characters."""
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    text = repr(value[:longest] if isinstance(value, str) else value)
    return text if len(text) <= longest else text[: longest - 3] + "..."
