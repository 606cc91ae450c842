"""What made the figures of a data file, and why figures of several origins may stand together."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

MEASUREMENTS = "measurements.md"  # the page of docs/ that tells every run


class Data(BaseModel):
    """Strict: a key that nobody reads is a mistake."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Run(Data):
    """What made the figures.

    Attributes:
        command: As it was typed.
        commit: Of this repository; None where it was not written down.
        date: Of the commit or, where that is not known, of the page that told the figures first.
        processor: And what else it did meanwhile; None where it was not written down.
        of: Which of the figures, where the file has several runs.
        settings: What has a bearing on the figures and is not in the command: versions, number of instances.
    """

    command: str
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{7,40}$")] | None
    date: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]
    processor: str | None = None
    of: str = ""
    settings: str = ""

    @property
    def typed(self) -> str:
        """The command, and what it made."""
        return f"{self.of}: " * bool(self.of) + f"`{self.command}`"

    @property
    def where(self) -> str:
        """All but the command, as words: commit, date, processor, settings."""
        commit = f"commit {self.commit}" if self.commit else "commit not recorded"
        words = [f"{commit}, {self.date}", self.processor or "processor not recorded", self.settings]
        return "; ".join(filter(None, words))


class Results(Data):
    """What every data file has.

    Attributes:
        runs: What made it.
        mixed: Why runs of several commits or processors stand together.
        name: Of the file, without its ending; set by who reads it.
    """

    runs: Annotated[tuple[Run, ...], Field(min_length=1)]
    mixed: str = ""
    name: str = ""

    @model_validator(mode="after")
    def _of_one_kind(self) -> Self:
        """Raises ValueError for figures of several commits or processors without a word."""
        kinds = _kinds(self.runs)
        if kinds > 1 and not self.mixed:
            raise ValueError(f"runs of {kinds} commits or processors in one table; say why in 'mixed'")
        return self

    def source(self, of: Collection[int] | None = None) -> str:
        """What made the figures, as the line below a table. What several runs were, the page of all measurements tells.

        Args:
            of: Places of the runs that the table is of; None: of all.
        """
        runs = [run for i, run in enumerate(self.runs) if of is None or i in of]
        if _kinds(runs) > 1:
            commits = dict.fromkeys(run.commit for run in runs if run.commit)
            dates = sorted({run.date for run in runs})
            told = f"commit{'s' * (len(commits) > 1)} {', '.join(commits)}, " if commits else "commits not recorded, "
            told += f"{dates[0]} to {dates[-1]}" if len(dates) > 1 else dates[0]
            return f"Of several runs: {self.mixed}; {told}; [commands and machines]({MEASUREMENTS}#{self.name})."
        typed: dict[str, list[str]] = {}
        for run in runs:
            typed.setdefault(run.where, []).append(run.typed)
        return " ".join(f"{'; '.join(commands)}; {where}." for where, commands in typed.items())

    @property
    def several(self) -> bool:
        """Whether the runs are of several commits or processors."""
        return _kinds(self.runs) > 1


def _kinds(runs: Iterable[Run]) -> int:
    """Of how many commits and processors they are."""
    return len({(run.commit, run.processor) for run in runs})


def grid(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(
        "|" + "|".join("---" if c == "---" else f" {c} " if c else " " for c in line) + "|" for line in lines
    )
