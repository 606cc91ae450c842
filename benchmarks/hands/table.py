"""The table of results: skill by skill, policy by policy, failures by cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from statistics import median
from typing import Any

from benchmarks.hands.rows import Job, Row


def table(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """One record for each skill, case, policy and setting, then one with case "all" for each skill of several cases."""
    cases: dict[tuple[str, ...], list[Row]] = {}
    skills: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        job = row.job
        cases.setdefault((job.skill, job.case, job.policy, setting(job)), []).append(row)
        skills.setdefault((job.skill, "all", job.policy, setting(job)), []).append(row)
    several = {k: members for k, members in skills.items() if len({row.job.case for row in members}) > 1}
    return [_record(group, members) for group, members in (*cases.items(), *several.items())]


def markdown(rows: Iterable[Row]) -> str:
    """The table for people."""
    lines = [
        "| skill | case | policy | setting | ok | median s | retries | x real time | failures |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for r in table(rows):
        failures = ", ".join(f"{count} {cause}" for cause, count in r["failures"].items())
        retries = "-" if r["retries"] is None else f"{r['retries']:.2f}"
        seconds = "-" if r["median_s"] is None else f"{r['median_s']:.1f}"
        scene = f"{r['skill']} | {r['case']} | {r['policy']} | {r['setting']}"
        lines.append(f"| {scene} | {r['ok']}/{r['n']} | {seconds} | {retries} | {r['realtime']:.1f} | {failures} |")
    return "\n".join(lines)


def setting(job: Job) -> str:
    """What is unusual about a job, such as "realistic noise, assisted"; "" if nothing is."""
    parts = [f"{job.noise} noise"] if job.noise != "none" else []
    parts += [f"{job.perception_cm:g} cm off"] if job.perception_cm else []
    parts += ["assisted"] if job.assisted else []
    parts += [" ".join(filter(None, ("pregrasp", job.pregrasp_hand)))] if job.pregrasp else []
    parts += [job.robot] if job.robot != "r1" else []
    return ", ".join(parts)


def _record(group: tuple[str, ...], rows: list[Row]) -> dict[str, Any]:
    skill, case, policy, how = group
    ok = [row for row in rows if row.ok]
    retries = [row.retries for row in rows if row.retries is not None]
    return {
        "skill": skill, "case": case, "policy": policy, "setting": how,
        "ok": len(ok), "n": len(rows),
        "median_s": median(row.simulated_s for row in ok) if ok else None,
        "retries": sum(retries) / len(retries) if retries else None,
        "realtime": median(row.realtime for row in rows),
        "failures": dict(Counter(row.cause for row in rows if not row.ok).most_common()),
    }  # fmt: skip
