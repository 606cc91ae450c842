"""Trials of what may break: one JSON line each, so that a killed run goes on where it stopped, and what came of all."""

from __future__ import annotations

import random
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Literal, get_args

import click

from benchmarks.rows import append, lines_of
from mpvi_bt.ground.errors import MpviError, UserError

End = Literal["went on", "refused", "lost", "hung", "misread", "crashed"]
ENDS: tuple[End, ...] = get_args(End)
BAD = ENDS[2:]
_TELL_S = 10.0  # between two lines of progress
_LONGEST = 2500  # characters of a line that a person may be told


@dataclass(frozen=True)
class Outcome:
    """What came of one trial.

    Attributes:
        of: What was tried, such as "tree: a line doubled".
        ended: "went on": nothing was wrong with it, or it was passed over; "refused": with a clear reason; "lost": what
            had been finished is gone, another, or was done twice; "hung": it took longer than it may; "misread": it was
            taken without a complaint for what it is not; "crashed": an exception of no kind that users are told of.
        told: The reason, or what is wrong.
    """

    of: str
    ended: End
    told: str = ""


class Hung(BaseException):
    """It takes longer than it may. No `Exception`, so that nothing under trial takes it for its own."""


Trial = Callable[[int], Outcome]


def drawn(seed: int, number: int) -> random.Random:
    """The random numbers of one trial, whichever were played before."""
    return random.Random(f"{seed} {number}")


@contextmanager
def within(cpu_s: float, wall_s: float) -> Iterator[None]:
    """Raise Hung if the block takes more processor time or wall time; in the main thread only."""

    def over(number: int, frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        raise Hung("".join(traceback.format_stack(frame)[-2:]))

    before = [signal.signal(number, over) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, cpu_s)
    signal.setitimer(signal.ITIMER_REAL, wall_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in zip((signal.SIGPROF, signal.SIGALRM), before, strict=True):
            signal.signal(number, handler)


def judged(
    of: str, act: Callable[[], str | None], cpu_s: float = 5.0, wall_s: float = 60.0, named: str = ""
) -> Outcome:
    """What comes of an act.

    Args:
        of: What is tried.
        act: Gives None where all went on, or what complaint there was; raises a `MpviError` to refuse.
        cpu_s, wall_s: It hangs if it takes longer.
        named: What a refusal has to name, such as a file.
    """
    try:
        with within(cpu_s, wall_s):
            said = act()
    except Hung as error:
        return Outcome(of, "hung", one_line(str(error)))
    except MpviError as error:
        said = str(error)
    except Exception as error:
        return Outcome(of, "crashed", crash(error))
    if said is None:
        return Outcome(of, "went on")
    wrong = unclear(said, named)
    return Outcome(of, "crashed", f"not clear ({wrong}): {one_line(said)}") if wrong else Outcome(of, "refused", said)


def unclear(said: str, named: str = "") -> str:
    """What is wrong with a complaint: "" if a person can go by it."""
    if not said.strip():
        return "it says nothing"
    if "Traceback (most recent call last)" in said:
        return "a traceback"
    if any(len(line) > _LONGEST for line in said.splitlines()):
        return "a long line"
    return f"{named} is not named" if named not in said else ""


def crash(error: BaseException) -> str:
    """An exception in one line: what, and where in our code."""
    frames = traceback.extract_tb(error.__traceback__)
    places = [f"{Path(f.filename).name}:{f.lineno}" for f in frames if "mpvi_bt" in f.filename]
    return one_line(f"{type(error).__name__}: {error} at {' > '.join(places[-3:]) or 'no line of ours'}")


def one_line(text: str, most: int = 300) -> str:
    """Text as a row keeps it."""
    return " ".join(text.split())[:most]


def options(count: int, out: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options that all have here: `seed`, `count`, `out` and `only`."""

    def add(function: Callable[..., None]) -> Callable[..., None]:
        for option in (
            click.option("--only", type=click.IntRange(min=0), metavar="N",
            help="Play number N alone, and tell it all."),
            click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default=f"runs/faults/{out}.jsonl",
                         show_default=True, help="Rows go here; what is there is not played again."),
            click.option("--count", "-n", type=click.IntRange(min=1), default=count, show_default=True),
            click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True),
        ):  # fmt: skip
            function = option(function)
        return function

    return add


def play(trial: Trial, seed: int, count: int, out: Path, only: int | None, name: str) -> None:
    """Play the trials of a seed that have no row yet, and say what came of all; ends with 1 where anything is bad.

    Args:
        trial: Number to outcome.
        seed: Of the trials.
        count: How many: numbers 0 to count - 1.
        out: File of the rows.
        only: Play this number alone, and write no row.
        name: Of the command, for how to repeat a trial.
    """
    try:
        if only is not None:
            outcome = trial(only)
            click.echo(f"{outcome.of}: {outcome.ended}\n{outcome.told}")
            sys.exit(int(outcome.ended in BAD))
        rows = {row["number"]: row for _, row in lines_of(out) if row.get("seed") == seed}
        told = time.monotonic()
        for number in range(count):
            if number in rows:
                continue
            began = time.monotonic()
            outcome = trial(number)
            row = {"seed": seed, "number": number, **asdict(outcome), "told": one_line(outcome.told)}
            append(out, rows.setdefault(number, {**row, "wall_s": round(time.monotonic() - began, 3)}))
            if outcome.ended in BAD:
                click.echo(f"{number}: {outcome.of}: {outcome.ended}: {one_line(outcome.told)}", err=True)
            if time.monotonic() - told > _TELL_S or number == count - 1:
                told = time.monotonic()
                click.echo(f"{len(rows)}/{count} {counted(list(rows.values()))}", err=True)
    except UserError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)
    wanted = [rows[number] for number in range(count)]
    click.echo(summary(wanted, name))
    sys.exit(int(any(row["ended"] in BAD for row in wanted)))


def counted(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many were lost, hung, misread, crashed."""
    ends = Counter(row["ended"] for row in rows)
    return ", ".join(f"{ends[end]} {end}" for end in BAD)


def summary(rows: Sequence[Mapping[str, Any]], name: str) -> str:
    """What came of trials, and the first of each bad end, with how to repeat it."""
    ends = Counter(row["ended"] for row in rows)
    lines = [f"{len(rows)} trials: {counted(rows)}; {ends['refused']} refused with a reason, {ends['went on']} went on"]
    for end in BAD:
        first = next((row for row in rows if row["ended"] == end), None)
        if first is not None:
            again = f"python -m benchmarks.faults.{name} --seed {first['seed']} --only {first['number']}"
            lines.append(f"first {end}: {first['of']}: {first['told']}\n  {again}")
    return "\n".join(lines)
