"""A suite's results as one self-contained HTML page: no network, no script, no other file but films."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.drawing.symbols import state_style
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.ground.version import __version__
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.runs.report import tables as t
from mpvi_bt.runs.report.choice import CHOICE_STYLE, ReportChoice
from mpvi_bt.runs.report.episode_map import house_symbol
from mpvi_bt.runs.report.episodes import Played, episode_html
from mpvi_bt.runs.report.figures import Figures
from mpvi_bt.runs.report.plot_svg import plot_style
from mpvi_bt.runs.report.plots import NARROW, improvement_plot, method_plot, shown_tasks
from mpvi_bt.runs.report.runs import Runs
from mpvi_bt.runs.report.tables import Table


def report_page(
    figures: Figures, runs: Sequence[Runs], page: Path | None = None, running: bool = False, when: str = ""
) -> str:
    """The page.

    Args:
        figures: Of the runs.
        runs: Whose episodes are told one by one.
        page: File that it goes to, beside which films are looked for.
        running: Whether more results are on their way.
        when: Date and time, for people.
    """
    houses = _houses(runs)
    looks = (resources.files("mpvi_bt.runs.report") / "page" / "report.css").read_text(encoding="utf-8")
    style = state_style() + plot_style() + looks + CHOICE_STYLE
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    sections = [(name, body) for name, body in _sections(figures, runs, houses, page) if body]
    links = "".join(f'<a href="#{_mark(name)}">{escape(name)}</a>' for name, _ in sections)
    written = " · ".join(filter(None, [when, f"mpvi_bt {__version__}"]))
    about = f"<p>{escape(one_line(figures.about))}</p>" if figures.about else ""
    about += "".join(f"<p>{escape(one_line(note))}</p>" for note in figures.notes)
    symbols = "".join(house_symbol(house) for house in {house.name: house for house in houses.values()}.values())
    body = "".join(
        f'<section><h2 id="{_mark(name)}">{escape(name)}</h2>{content}</section>' for name, content in sections
    )
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'sha256-{digest}'; \
media-src 'self' file:; img-src 'self' file:; base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(one_line(figures.suite))}</title>
<style>{style}</style>
</head>
<body>
<header><h1>{escape(one_line(figures.suite))}</h1>{about}
<p class="dim">{escape(t.standing(figures, running))} {escape(written)}</p></header>
<nav aria-label="Sections"><div>{links}</div></nav>
<svg class="symbols" aria-hidden="true">{symbols}</svg>
<main>{body}</main>
</body>
</html>
"""


def _sections(
    figures: Figures, runs: Sequence[Runs], houses: Mapping[Played, House], page: Path | None
) -> Iterator[tuple[str, str]]:
    """Name and content of each; "" where there is nothing to say."""
    yield "Summary", f"{_table(t.summary_table(figures))}<p>{escape(one_line(t.truth_text(figures)))}</p>"
    compared: list[str] = []
    for found in figures.comparisons:
        title = f"{found.method} against {found.baseline}"
        told = f"<p>{escape(t.comparison_text(found))}</p>"
        told += _both(improvement_plot(found), improvement_plot(found, NARROW))
        told += _folded("task by task", _table(t.comparison_table(found), titled=False))
        compared.append(_folded(title, told) if compared else f"<h3>{escape(title)}</h3>{told}")
    if compared:
        compared.insert(0, _table(t.comparisons_table(figures.comparisons), titled=False))
        compared.append(_table(t.effort_table(figures.comparisons)))
    yield "Improvement", "".join(compared)
    done = any(method.overall.finished for method in figures.methods)
    yield (
        "Methods on each task",
        _both(method_plot(figures), method_plot(figures, NARROW)) + _omitted(figures) if done else "",
    )
    tasks = [_table(t.task_table(figures))]
    tasks += [
        _folded(table.title, _table(table, titled=False))
        for method in figures.methods
        if (table := t.instance_table(method)).rows
    ]
    yield "Tasks", "".join(tasks)
    yield "Houses", _filled(t.house_table(figures), titled=False)
    efficiency = _table(t.efficiency_table(figures)) + "".join(
        _folded(task, _table(t.efficiency_table(figures, task), titled=False)) for task in figures.tasks
    )
    yield "Time and distances", efficiency + _folded("what is measured", _table(t.direction_table(), titled=False))
    failures = [_table(table) for table in t.failure_tables(figures)]
    failures += [
        _folded(f"{method.name}, task by task", _table(table, titled=False))
        for method in figures.methods
        if (table := t.failure_table_of(method)).rows
    ]
    yield "Failures", "".join(failures)
    yield "Parts", _table(t.settings_table(figures), titled=False) + _filled(t.wall_table(figures))
    yield "Missing", _filled(t.missing_table(figures), titled=False)
    choice = ReportChoice.of(runs)
    yield "Episodes", choice.html + "".join(_episodes(run, houses, page, choice) for run in runs if run.results)


def _episodes(runs: Runs, houses: Mapping[Played, House], page: Path | None, choice: ReportChoice) -> str:
    parts = []
    for task in runs.tasks:
        done = [config for config in runs.episodes if config.task_name == task and config in runs.results]
        if done:
            q = sum(runs.results[config].q for config in done) / len(done)
            told = f"{task} · {len(done)} episode{'s' * (len(done) > 1)}, mean q {q:.2f}"
            kinds = [choice.kinds(runs.results[config]) for config in done]
            pages = [episode_html(runs, c, houses, page, k) for c, k in zip(done, kinds, strict=True)]
            look = " ".join(dict.fromkeys(kind for found in kinds for kind in found))
            parts.append(_folded(told, "".join(pages), f"task {look}"))
    return f"<h3>{escape(one_line(runs.method))}</h3>{''.join(parts)}"


def _houses(runs: Sequence[Runs]) -> dict[Played, House]:
    """Task, and the house that was named in place of its own, to the house; what is not there any more is left out."""
    loaded: dict[str, House] = {}
    houses = {}
    for task, named in dict.fromkeys((config.task_name, config.house) for run in runs for config in run.episodes):
        try:
            data, _ = load_marked(
                paths.find_or_file("tasks", task, "task")
            )  # all else in the file was checked long ago
            name = named or data["house"]
            if name not in loaded:
                loaded[name] = load_house(name)
            houses[task, named] = loaded[name]
        except (MpviError, KeyError, TypeError):
            continue
    return houses


def _omitted(figures: Figures) -> str:
    left = [task for task in figures.tasks if task not in shown_tasks(figures)]
    run = {task for method in figures.methods for task, group in method.tasks.items() if group.finished}
    told = "A bar is the mean, a point an instance; the line on the bar of all tasks is its interval."
    for tasks, why in (
        ([task for task in left if task in run], "Left out, since no method got anything"),
        ([task for task in left if task not in run], "No results yet"),
    ):
        told += f" {why}: {', '.join(tasks)}." if tasks else ""
    return f'<p class="dim">{escape(one_line(told))}</p>'


def _both(wide: str, narrow: str) -> str:
    """A plot for pages, and one for telephones."""
    return f'<figure class="wide">{wide}</figure><figure class="narrow">{narrow}</figure>'


def _folded(title: str, body: str, look: str = "") -> str:
    named = f' class="{look}"' if look else ""
    return f"<details{named}><summary>{escape(one_line(title))}</summary>{body}</details>"


def _filled(table: Table, titled: bool = True) -> str:
    return _table(table, titled) if table.rows else ""


def _table(table: Table, titled: bool = True) -> str:
    kinds = [' class="number"' if figures else "" for figures in table.figures]
    head = "".join(f'<th scope="col"{k}>{escape(one_line(c))}</th>' for c, k in zip(table.head, kinds, strict=True))
    rows = "".join(
        f'<tr><th scope="row"{kinds[0]}>{escape(one_line(row[0]))}</th>'
        + "".join(f"<td{kind}>{_cell(cell)}</td>" for cell, kind in zip(row[1:], kinds[1:], strict=True))
        + "</tr>"
        for row in table.rows
    )
    title = f"<h3>{escape(one_line(table.title))}</h3>" if table.title and titled else ""
    note = f'<p class="dim">{escape(table.note)}</p>' if table.note else ""
    body = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f'{title}<div class="scroll" tabindex="0">{body}</div>{note}'


def _cell(text: str) -> str:
    """What a table's cell says, its interval in a line below."""
    return re.sub(r" (\[[^\]]*\])", r" <small>\1</small>", escape(one_line(text)))


def _mark(name: str) -> str:
    return re.sub(r"[^a-z]+", "-", name.lower())
