"""The page section for one episode: goal, failures, map, timeline and film."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from urllib.parse import quote

from mpvi_bt.executive.drawing.cells import cut, one_line
from mpvi_bt.executive.monitors.handoff_text import handoff_line, handoff_lines
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.words.spoken import spoken_texts
from mpvi_bt.house.layout.house import House
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.closing_table import troubles
from mpvi_bt.runs.report.episode_map import way_map
from mpvi_bt.runs.report.runs import Runs
from mpvi_bt.runs.report.timeline import timeline, timeline_html

# Our choices: what a page of hundreds of episodes can hold of each.
Played = tuple[str, str | None]  # task, and the house named in place of its own
MOST_FAILURES, MOST_CONDITIONS, MOST_HANDOFFS, _LONG = 8, 30, 6, 160


def episode_html(
    runs: Runs, config: EpisodeConfig, houses: Mapping[Played, House], page: Path | None, kinds: Iterable[str] = ()
) -> str:
    """An episode that has a result, folded.

    Args:
        runs: Of its method.
        config: The episode.
        houses: By task and the house named in place of its own; those whose symbols are in the page.
        page: Its file, beside which films and pictures are looked for; None: there are no links to files.
        kinds: Classes of it, by which a reader chooses.
    """
    result = runs.results[config]
    films, pictures = _film(runs, config, page), _picture(runs, config, page)
    seen = "".join(f" · {what}" for what, there in (("film", films), ("picture", pictures)) if there)
    where = f"{escape(one_line(config.house_name))}, " if config.house else ""
    head = (
        f'<span class="pill {"good" if result.success else "bad"}">q {result.q:.2f}</span> '
        f"{where}instance {result.instance_id}, seed {result.rollout_id} "
        f'<span class="dim">{escape(one_line(result.told))}{seen}</span>'
    )
    drawn = way_map(result.way, houses.get((config.task_name, config.house))) if result.way else ""
    drawn = drawn or '<p class="dim">The way was not kept.</p>'
    body = [
        f'<div class="sides"><figure>{drawn}</figure><div>{_goal(result)}{_facts(result)}</div></div>',
        _failures(result),
        _handoffs(result),
        _what_ran(runs, config, result),
        pictures,
        films,
    ]
    mark = f"{runs.method}-{config.name}"
    look = " ".join(("episode", *kinds))
    return f'<details class="{look}" id="{escape(mark)}"><summary>{head}</summary>{"".join(body)}</details>'


def _goal(result: Result) -> str:
    texts = spoken_texts(c.condition for c in result.goal)
    rows = sorted(zip(result.goal, texts, strict=True), key=lambda row: row[0].satisfied)[:MOST_CONDITIONS]
    items = [f'<li class="{"met" if c.satisfied else "unmet"}">{_text(text)}</li>' for c, text in rows]
    more = len(result.goal) - len(items)
    met = sum(c.satisfied for c in result.goal)
    rest = f'<li class="dim">and {more} more</li>' if more > 0 else ""
    return f"<h5>Goal: {met} of {len(result.goal)} conditions hold</h5><ul class='goal'>{''.join(items)}{rest}</ul>"


def _facts(result: Result) -> str:
    way, ratio = result.agent_distance, result.time.normalized_time
    facts = [f"base {way.base:.1f} m, hands {way.left:.1f} m and {way.right:.1f} m"]
    if ratio is not None:
        facts.append(f"people take {ratio:.2f} of its time")
    facts += filter(None, [troubles(result.clipped, result.grasps.empty, result.grasps.lost)])
    if result.queries.asked:
        facts.append(f"the checker was asked {result.queries.asked} times")
    if result.replans:
        facts.append(f"planned anew {len(result.replans)} times")
    return f'<p class="dim">{escape("; ".join(facts))}</p>'


def _failures(result: Result) -> str:
    if not result.failures:
        return ""
    items = []
    for failure in result.failures[:MOST_FAILURES]:
        node = "/".join(failure.node.split("/")[1:2]) or failure.node
        why = f": {_text(failure.feedback)}" if failure.feedback else ""
        items.append(f"<li>{failure.time_s:.0f} s, {_text(node)}: <code>{_text(failure.reason)}</code>{why}</li>")
    if more := len(result.failures) - len(items):
        items.append(f'<li class="dim">and {more} more</li>')
    return f"<h5>Failures</h5><ul>{''.join(items)}</ul>"


def _handoffs(result: Result) -> str:
    """The policy's handoffs: in full if no checker confirmed them, else only counted."""
    diagnosis = result.timed_diagnosis
    if diagnosis is None:
        return '<p class="dim">What the policy did in each handoff was not kept.</p>'
    short = [handoff for handoff in diagnosis if not handoff.complete]
    items = []
    for handoff in short[-MOST_HANDOFFS:]:
        more = "".join(f"<li>{_text(line)}</li>" for line in handoff_lines(handoff))
        head = f"{handoff.began_s:.0f} to {handoff.ended_s:.0f} s, “{_text(handoff.prompt)}”"
        items.append(
            f'<li>{head}: <b>{_text(handoff_line(handoff))}</b><details><summary class="dim">figures</summary>'
            f"<ul>{more}</ul></details></li>"
        )
    if (more_ := len(short) - len(items)) > 0:
        items.insert(0, f'<li class="dim">and {more_} before</li>')
    total = len(diagnosis)
    told = f"{total} to the policy, {total - len(short)} confirmed by a checker"
    return f"<h5>Handoffs: {told}</h5><ul>{''.join(items)}</ul>" if total else ""


def _what_ran(runs: Runs, config: EpisodeConfig, result: Result) -> str:
    path = runs.folder / "traces" / f"{config.name}.jsonl" if runs.folder else None
    if path is None or not path.is_file():
        return '<p class="dim">There is no trace that says what ran when.</p>'
    try:
        rows = timeline(read_trace(path))
    except MpviError as error:
        return f'<p class="dim">Its trace cannot be read: {_text(str(error))}</p>'
    file = _text(shlex.quote(str(path)))
    why = "" if result.success else f"Why: <code>mpvi explain {file}</code>. "
    more = f"<p class='dim'>{why}Every tick: <code>mpvi render {file} --out run.html</code></p>"
    return f"<h5>What ran when</h5>{timeline_html(rows, result.time.simulator_time)}{more}"


def _film(runs: Runs, config: EpisodeConfig, page: Path | None) -> str:
    if not (address := _address(runs, "videos", f"{config.name}.mp4", page)):
        return ""
    poster = _address(runs, "videos", f"{config.name}.poster.jpg", page)
    shown = f' poster="{poster}"' if poster else ""
    return (
        f'<h5>Film</h5><video controls preload="none"{shown} src="{address}"></video>'
        f'<p><a href="{address}">{address}</a></p>'
    )


def _picture(runs: Runs, config: EpisodeConfig, page: Path | None) -> str:
    if not (address := _address(runs, "pictures", f"{config.name}.png", page)):
        return ""
    image = f'<img loading="lazy" alt="The way, from above" src="{address}">'
    return f'<h5>Picture</h5><a href="{address}">{image}</a>'


def _address(runs: Runs, kind: str, name: str, page: Path | None) -> str:
    """Link from the page to a file of an episode, escaped for HTML; "" without a file."""
    path = runs.folder / kind / name if runs.folder else None
    if path is None or page is None or not path.is_file():
        return ""
    return escape(quote(Path(os.path.relpath(path.resolve(), page.resolve().parent)).as_posix()))


def _text(text: str) -> str:
    return escape(cut(one_line(text), _LONG))
