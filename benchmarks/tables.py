"""`python -m benchmarks.tables`: the tables of measurements in the docs, written from `benchmarks/results/`.

A page says where a table goes by two comments, and what stands between them is made here:

    <!-- results: searches -->
    ...
    <!-- end of results -->

The data file of that name holds the figures beside the command, commit, date and processor that made them. Figures of
several commits or processors in one table are refused unless the file says why they are together (`mixed`); the table
then says so too.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import click
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from mpvi_bt.errors import UnknownName, UserError
from mpvi_bt.report.statistics import estimate

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "benchmarks" / "results"
BLOCK = re.compile(r"(<!-- results: (?P<name>\w+) -->\n).*?(<!-- end of results -->)", re.DOTALL)


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

    def __str__(self) -> str:
        """One line for a person."""
        commit = f"commit {self.commit}" if self.commit else "commit not recorded"
        words = [
            f"`{self.command}`",
            f"{commit}, {self.date}",
            self.processor or "processor not recorded",
            self.settings,
        ]
        return f"{self.of}: " * bool(self.of) + "; ".join(filter(None, words))


class Results(Data):
    """What every data file has: the runs, and why there are several."""

    runs: Annotated[tuple[Run, ...], Field(min_length=1)]
    mixed: str = ""

    @model_validator(mode="after")
    def _of_one_kind(self) -> Self:
        """Raises ValueError for figures of several commits or processors without a word."""
        kinds = {(run.commit, run.processor) for run in self.runs}
        if len(kinds) > 1 and not self.mixed:
            raise ValueError(f"runs of {len(kinds)} commits or processors in one table; say why in 'mixed'")
        return self

    def source(self) -> str:
        """What made the figures, as the line below a table."""
        mixed = [f"**Of several runs: {self.mixed}.**"] if self.mixed else []
        return " ".join([*mixed, *(f"{run}." for run in self.runs)])


Cell = str | int | float | tuple[int, int] | None


class Column(Data):
    """A column. `format` is Python's, of its numbers."""

    head: str
    format: str = ""

    def cell(self, value: Cell) -> str:
        """A value as the table shows it; a pair is a count out of another."""
        if value is None:
            return ""
        if isinstance(value, tuple):
            return f"{value[0]}/{value[1]}"
        return value if isinstance(value, str) else format(value, self.format)


class Table(Results):
    """A table as it is."""

    kind: Literal["table"]
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @model_validator(mode="after")
    def _is_rectangular(self) -> Self:
        """Raises ValueError for a row of another length than the columns."""
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(f"rows[{i}] has {len(row)} cells for {len(self.columns)} columns")
        return self

    def render(self) -> str:
        """As Markdown."""
        rows = [[c.cell(value) for c, value in zip(self.columns, row, strict=True)] for row in self.rows]
        return f"{grid([c.head for c in self.columns], rows)}\n\n*{self.source()}*"


class TaskScores(Data):
    """What came of one task.

    Attributes:
        q: Of each instance, in their order; None for an episode that broke, which counts as 0.
        gave_up: Why units were given up in the episodes that missed something, the most frequent first.
    """

    q: Annotated[tuple[float | None, ...], Field(min_length=1)]
    gave_up: str = ""

    @property
    def scores(self) -> list[float]:
        """q of each instance; what broke is 0."""
        return [score or 0.0 for score in self.q]

    @property
    def successes(self) -> int:
        """Episodes that met the whole goal."""
        return self.scores.count(1.0)


class Episodes(Results):
    """q of the episodes of a suite, its tasks in BEHAVIOR's order; means, intervals and counts follow from them."""

    kind: Literal["episodes"]
    tasks: Annotated[dict[str, TaskScores], Field(min_length=1)]

    def render(self) -> str:
        """Headline and table, as Markdown."""
        tasks = self.tasks.values()
        found = estimate([np.array([task.scores]).T for task in tasks])
        interval = f" ({found.low:.2f} to {found.high:.2f})" if found and found.low is not None else ""
        mean = np.mean([np.mean(task.scores) for task in tasks])
        episodes, instances = sum(len(task.q) for task in tasks), max(len(task.q) for task in tasks)
        whole = sum(task.successes == len(task.q) for task in tasks)
        headline = (
            f"**Mean q {mean:.2f}{interval}; {sum(task.successes for task in tasks)} of {episodes} episodes met the "
            f"whole goal; {whole} of {len(self.tasks)} tasks did in all instances.**"
        )
        heads = ["id", "task", "mean q", f"q = 1, of {instances}", "q of each instance", "given up because of"]
        rows = [
            [f"{i}", f"`{name}`", f"{np.mean(t.scores):.2f}", f"{t.successes}", _listed(t.q), t.gave_up]
            for i, (name, t) in enumerate(self.tasks.items())
        ]
        return f"{headline}\n\n{grid(heads, rows)}\n\n*{self.source()}*"


def _listed(scores: Sequence[float | None]) -> str:
    """Scores in a row; a broken episode is "-"."""
    return ", ".join("-" if score is None else f"{score:.2f}".rstrip("0").rstrip(".") for score in scores)


FILE: TypeAdapter[Table | Episodes] = TypeAdapter(Annotated[Table | Episodes, Field(discriminator="kind")])


def grid(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(
        "|" + "|".join("---" if c == "---" else f" {c} " if c else " " for c in line) + "|" for line in lines
    )


def load(name: str) -> Table | Episodes:
    """Read a data file.

    Raises:
        UserError: There is none of that name, or what is in it is none.
    """
    file = RESULTS / f"{name}.json"
    if not file.exists():
        raise UnknownName("results", name, [other.stem for other in RESULTS.glob("*.json")])
    try:
        return FILE.validate_json(file.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"][1:]))
        raise UserError(f"{file.relative_to(ROOT)}: {where}: {first['msg']}".replace(": : ", ": ")) from None


def filled(page: str) -> str:
    """The text of a page with its tables made anew."""
    return BLOCK.sub(lambda block: f"{block[1]}\n{load(block['name']).render()}\n\n{block[3]}", page)


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; end with 1 where a page is not what its data make.")
def main(check: bool) -> None:
    """Write the tables of measurements into the pages of docs/, from benchmarks/results/."""
    try:
        stale, used = [], set()
        for page in sorted(ROOT.joinpath("docs").glob("*.md")):
            text = page.read_text(encoding="utf-8")
            used.update(block["name"] for block in BLOCK.finditer(text))
            new = filled(text)
            if new != text:
                stale.append(page)
                if not check:
                    page.write_text(new, encoding="utf-8")
        unused = sorted({file.stem for file in RESULTS.glob("*.json")} - used)
        if unused:
            raise UserError(f"benchmarks/results/{unused[0]}.json is on no page of docs/")
    except UserError as error:
        click.echo(f"tables: {error}", err=True)
        sys.exit(error.exit_code)
    for page in stale:
        click.echo(f"{page.relative_to(ROOT)}: {'is not what its data make; run make results' if check else 'written'}")
    sys.exit(int(check and bool(stale)))


if __name__ == "__main__":
    main()
