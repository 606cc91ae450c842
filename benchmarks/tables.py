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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import click
import numpy as np
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from benchmarks.origin import Data, Results, Run, grid
from benchmarks.played import Played
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.report.statistics import estimate

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "benchmarks" / "results"
BLOCK = re.compile(
    r"(?P<head><!-- results: (?P<name>\w+)(?: (?P<view>[\w ]+))? -->\n).*?(?P<end><!-- end of results -->)", re.DOTALL
)
EVERY = "every_run"  # in the place of a name: what made each data file


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


File = Table | Episodes | Played
FILE: TypeAdapter[File] = TypeAdapter(Annotated[File, Field(discriminator="kind")])


def load(name: str) -> File:
    """Read a data file.

    Raises:
        UserError: There is none of that name, or what is in it is none.
    """
    file = RESULTS / f"{name}.json"
    if not file.exists():
        raise UnknownName("results", name, [other.stem for other in RESULTS.glob("*.json")])
    try:
        return FILE.validate_json(file.read_bytes()).model_copy(update={"name": name})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"][1:]))
        raise UserError(f"{file.relative_to(ROOT)}: {where}: {first['msg']}".replace(": : ", ": ")) from None


def made_anew(pages: Mapping[Path, str]) -> dict[Path, str]:
    """The pages with their tables made anew, and the plots that they show.

    Raises:
        UserError: As of `load`; a block asks for a view that there is not; or a data file is on no page.
    """
    blocks = [(page, block) for page, text in pages.items() for block in BLOCK.finditer(text)]
    homes: dict[str, str] = {}  # of each data file the page that shows it first
    for page, block in blocks:
        if block["name"] != EVERY:
            homes.setdefault(block["name"], page.name)
    made = {
        page: BLOCK.sub(lambda block: f"{block['head']}\n{shown(block, homes)}\n\n{block['end']}", text)
        for page, text in pages.items()
    }
    for page, block in blocks:
        if block["view"] == "plot" and isinstance(file := load(block["name"]), Played):
            made[page.with_name(f"{block['name']}.svg")] = file.plot()
    if unused := sorted({file.stem for file in RESULTS.glob("*.json")} - homes.keys()):
        raise UserError(f"benchmarks/results/{unused[0]}.json is on no page of docs/")
    return made


def shown(block: re.Match[str], homes: Mapping[str, str]) -> str:
    """What stands in a block: a table, or a picture that is a file of its own beside the page."""
    name, view = block["name"], block["view"]
    if name == EVERY:
        return every_run(homes)
    file = load(name)
    try:
        if isinstance(file, Played):
            return f"![q of each task and method]({name}.svg)" if view == "plot" else file.render(view or "methods")
        if view:
            raise UserError(f"there is but one view of it, not {view!r}")
        return file.render()
    except UserError as error:
        raise UserError(f"benchmarks/results/{name}.json: {error}") from None


def every_run(homes: Mapping[str, str]) -> str:
    """What made each data file, the youngest first; below, by name, the runs of those that have several."""
    files = sorted(((load(name), page) for name, page in homes.items()), key=lambda pair: _age(pair[0]), reverse=True)
    rows = [
        [f"[{file.name}]({page})", f"[{len(file.runs)} runs](#{file.name})", *_between(file)]
        if file.several
        else [f"[{file.name}]({page})", "; ".join(run.typed for run in file.runs), *_told(file.runs[0])]
        for file, page in files
    ]
    heads = ["command", "commit", "date", "processor"]
    parts = [grid(["data", *heads], rows)]
    for file, _ in files:
        if file.several:
            runs = grid(heads, [[run.typed, *_told(run)] for run in file.runs])
            parts.append(f"## {file.name}\n\n{file.mixed[0].upper()}{file.mixed[1:]}.\n\n{runs}")
    return "\n\n".join(parts)


def _age(file: File) -> tuple[str, str]:
    return max(run.date for run in file.runs), file.name


def _told(run: Run) -> list[str]:
    """Commit, date and processor with what else has a bearing."""
    processor = "; ".join(filter(None, [run.processor or "not recorded", run.settings]))
    return [run.commit or "not recorded", run.date, processor]


def _between(file: File) -> list[str]:
    """The same of a file of several runs, as far as it is short."""
    commits = dict.fromkeys(run.commit or "not recorded" for run in file.runs)
    dates = sorted({run.date for run in file.runs})
    return [", ".join(commits), " to ".join(dict.fromkeys([dates[0], dates[-1]])), "of each run below"]


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; end with 1 where a page is not what its data make.")
def main(check: bool) -> None:
    """Write the tables of measurements into the pages of docs/, from benchmarks/results/."""
    try:
        pages = {page: page.read_text(encoding="utf-8") for page in sorted(ROOT.joinpath("docs").glob("*.md"))}
        made = made_anew(pages)
    except UserError as error:
        click.echo(f"tables: {error}", err=True)
        sys.exit(error.exit_code)
    stale = {path: text for path, text in made.items() if not path.exists() or path.read_text("utf-8") != text}
    for path, text in stale.items():
        if not check:
            path.write_text(text, encoding="utf-8")
        click.echo(f"{path.relative_to(ROOT)}: {'is not what its data make; run make results' if check else 'written'}")
    sys.exit(int(check and bool(stale)))


if __name__ == "__main__":
    main()
