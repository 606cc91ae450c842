"""Summary of a finished run, in lines of at most 80 columns."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mpvi_bt.executive.drawing.endings import ended, gave_up


def score(result: Mapping[str, Any], trace: Path | None = None, saved: Path | None = None) -> str:
    """Of an episode.

    Args:
        result: Of the episode.
        trace: Where to read why it failed.
        saved: What an interrupted one can go on from.
    """
    normalized = result["time"]["normalized_time"]
    human = f", {normalized:.2f} of human speed" if result["success"] and normalized is not None else ""
    moved = result["agent_distance"]
    met = sum(condition["satisfied"] for condition in result["goal"])
    entries = [
        ("goal", f"{met} of {len(result['goal'])} conditions{_credited(result)}"),
        *(("", f"{'met' if c['satisfied'] else 'not met':7}  {c['condition']}") for c in result["goal"]),
        ("time", f"{result['time']['simulator_time']:.1f} s simulated{human}"),
        ("distance", f"base {moved['base']:.1f} m, left hand {moved['left']:.1f} m, right hand {moved['right']:.1f} m"),
        *((("plan", made),) if (made := _planned(result)) else ()),
        *_failed(result),
        *_replanned(result),
        *((("actions", pace),) if (pace := _paced(result)) else ()),
        *((("hands", felt),) if (felt := _felt(result)) else ()),
        *((("checks", asked),) if (asked := _asked(result)) else ()),
        ("wall", _wall(result["wall"])),
        *(("", row) for row in _by_doing(result["wall"])),
        *(
            [("grasps", "assisted: fixed to the hand, not held by friction")]
            if result.get("config", {}).get("assisted")
            else []
        ),
        *((("eyes", eyes),) if (eyes := _eyes(result)) else ()),
        ("truth", f"read by {', '.join(result['privileged']) or 'none'}"),
    ]
    verdict = {"SUCCESS": "goal met", "FAILURE": "goal not met"}.get(said := _verdict(result), said)
    head = f"q = {result['q_score']['final']:.3f}  {verdict}{_ended(result, '; ')}"
    return "\n".join([head, *(_entry(name, text) for name, text in entries), *_next(result, trace, saved)])


def brief_score(
    result: Mapping[str, Any], dry: bool = True, trace: Path | None = None, saved: Path | None = None
) -> str:
    """The summary of a run without a score: a dry run, or one ended by an exception."""
    verdict = "FINISHED" if result["success"] and result["failures"] else _verdict(result)
    head = f"{verdict}{'  dry run' * dry}{_ended(result, ': ' if dry else '  ')}"
    ticks = "1 tick" if result["ticks"] == 1 else f"{result['ticks']} ticks"
    time = f"{result['time']['simulator_time']:.1f} s simulated, {ticks}"
    entries = [("time", time), *_failed(result), *_replanned(result)]
    return "\n".join([head, *(_entry(name, text) for name, text in entries), *_next(result, trace, saved)])


def _verdict(result: Mapping[str, Any]) -> str:
    verdicts = {"interrupted": "STOPPED", "backend_error": "BACKEND ERROR", "error": "ERROR"}
    return "SUCCESS" if result["success"] else verdicts.get(result["ended"], "FAILURE")


def _ended(result: Mapping[str, Any], before: str) -> str:
    """How the plan, or the tree given instead, ended; "" if the verdict says the same."""
    own = result.get("config", {}).get("tree") or not result.get("plan", True)
    told = ended(result["ended"], gave_up(result["ended"], len(result["failures"])), plan=not own)
    return "" if told.upper() == _verdict(result) else before + told


def _credited(result: Mapping[str, Any]) -> str:
    """The other two scores, where they say more than the first."""
    scores = [result.get(key, result["q_score"]["final"]) for key in ("goal_fraction", "conditions_met")]
    if scores == [result["q_score"]["final"]] * 2:
        return ""
    return f" ({scores[1]:.3f}); q = {scores[0]:.3f} with what held at the start"


def _failed(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    given_up = gave_up(result["ended"], len(result["failures"]))
    for i, failure in enumerate(result["failures"]):
        said = failure["feedback"] or failure["reason"]
        yield "gave up" if i < given_up else "failed", f"{failure['time_s']:.1f} s: {_part(failure['node'])}: {said}"


def _eyes(result: Mapping[str, Any]) -> str:
    """Which parts see by what; "" if none looks at pictures."""
    told = {"pixels": "pixels", "labels": "labels of the renderer"}
    by = {eyes: [kind for kind, own in result.get("eyes", {}).items() if own == eyes] for eyes in told}
    said = [f"{told[eyes]} ({', '.join(kinds)})" for eyes, kinds in by.items() if kinds]
    return "; ".join(said)


def _replanned(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for replan in result.get("replans", ()):
        count = replan["segments"]
        came = f"no new plan: {replan['said']}" if count is None else f"new plan: {count} segment{'s' * (count != 1)}"
        yield "replanned", f"{replan['time_s']:.1f} s: {_part(replan['node'])}: {came}"


def _felt(result: Mapping[str, Any]) -> str:
    from mpvi_bt.runs.report.closing_table import troubles  # it needs numpy, which the help does not

    grasps = result.get("grasps", {})
    return troubles(result.get("clipped", 0), grasps.get("empty", 0), grasps.get("lost", 0))


def _paced(result: Mapping[str, Any]) -> str:
    """How the policy's rows were carried out; "" if nothing is recorded."""
    if (pace := result.get("actions")) is None:
        return ""
    kind = "" if pace["kind"] == "absolute" else f", {pace['kind']}"
    who = "nobody says the policy's rate" if pace["said_by"] == "nobody" else f"by {pace['said_by']}"
    return f"{pace['rate_hz']:g} rows a second{kind}: {who}"


def _planned(result: Mapping[str, Any]) -> str:
    """What the plan took, if a language model made it."""
    took = result.get("planning")
    if not took:
        return ""
    count = f"{took['answers']} answer{'s' * (took['answers'] > 1)}"
    tokens = took["tokens_in"] + took["tokens_out"]
    return f"by {result['config']['planner']}: {count} in {took['latency_s']:.1f} s, {tokens} tokens"


def _asked(result: Mapping[str, Any]) -> str:
    from mpvi_bt.runs.episode.queries import Queries, queries_text  # it needs pydantic, which the help does not

    return queries_text([Queries.model_validate(result["queries"])]) if "queries" in result else ""


def _next(result: Mapping[str, Any], trace: Path | None, saved: Path | None) -> list[str]:
    """Commands to find the reason or to continue; lines to copy, of any length."""
    interrupted = result["ended"] == "interrupted"
    failed = result["failures"] or not (result["success"] or interrupted)
    why = [f"  why       mpvi explain {shlex.quote(str(trace))}"] if failed and trace else []
    return why + ([f"  go on     mpvi run --resume {shlex.quote(str(saved))}"] if interrupted and saved else [])


def _part(path: str) -> str:
    """The part of the plan with this node: the child of the root above it."""
    below_root = path.split("/")[1:]
    return below_root[0] if below_root else path


def _entry(name: str, text: str) -> str:
    return textwrap.fill(text, 80, initial_indent=f"  {name:10}", subsequent_indent=" " * 12, break_on_hyphens=False)


def _wall(wall: Mapping[str, Any]) -> str:
    """Wall time by activity, the largest first; shares below 1 % are left out.

    For how long it was paused is told apart, in seconds: shares are of the time in which it worked.
    """
    parts = {"setting up": wall["setup_s"], **wall["loop"]}
    parts.pop("total", None)
    paused = parts.pop("paused", 0.0)
    total = max(wall["total_s"] - paused, 1e-9)
    shares = sorted(((seconds / total, name) for name, seconds in parts.items()), reverse=True)
    head = f"{total:.1f} s" + (f", and {paused:.1f} s paused" if paused else "")
    return f"{head}: " + ", ".join(f"{name} {share:.0%}" for share, name in shares if share >= 0.01)


def _by_doing(wall: Mapping[str, Any]) -> Iterator[str]:
    """Wall time by what the robot did, the longest first, and of that by activity; of a profiled episode."""
    rows = sorted(wall.get("doing", {}).items(), key=lambda row: -sum(row[1].values()))
    for name, activities in rows:
        largest = sorted((item for item in activities.items() if item[1] >= 0.05), key=lambda one: -one[1])
        parts = ": " + ", ".join(f"{activity} {seconds:.1f}" for activity, seconds in largest)
        if largest:
            yield f"{name} {sum(activities.values()):.1f} s{parts * (len(largest) > 1)}"
