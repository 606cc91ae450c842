"""Columns of tables for spreadsheets and papers, chosen by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.report.runs import MEASURES, Measure, Runs

PAPER = "paper_q"  # of the method of that name, on the task


def _ended(run: Runs, config: EpisodeConfig) -> str:
    """How the episode ended; of one without a result why there is none."""
    result, fault = run.results.get(config), run.faults.get(config)
    return result.ended if result else fault.kind if fault else "missing"


WHICH: Mapping[str, Callable[[Runs, EpisodeConfig], str]] = {
    "method": lambda run, config: run.method,
    "task": lambda run, config: config.task_name,
    "house": lambda run, config: config.house_name,
    "instance": lambda run, config: str(config.instance),
    "seed": lambda run, config: str(config.seed),
    "ended": _ended,
}
MEASURED: Mapping[str, Measure] = {"success" if m.key == "success_rate" else m.key: m for m in MEASURES}
COLUMNS = (*WHICH, *MEASURED)  # where none are chosen
KNOWN = (*COLUMNS, PAPER)


def read_columns(text: str) -> tuple[str, ...]:
    """The columns of "method,q_score,success", in that order.

    Raises:
        UnknownName: There is none of that name.
        UserError: None is named, or one twice.
    """
    names = tuple(name.strip() for name in text.split(","))
    for i, name in enumerate(names):
        if name not in KNOWN:
            raise UnknownName("column", name, KNOWN, "--columns")
        if name in names[:i]:
            raise UserError(f"--columns: {name} is given twice.")
    return names


def rows_of(run: Runs, columns: Sequence[str]) -> list[list[EpisodeConfig]]:
    """A method's episodes in groups: equal in all the chosen columns that describe an episode."""
    groups: dict[tuple[str, ...], list[EpisodeConfig]] = {}
    for config in run.episodes:
        groups.setdefault(tuple(WHICH[name](run, config) for name in columns if name in WHICH), []).append(config)
    return list(groups.values())
