"""The result of a run without a score: a dry run, or one on a robot elsewhere."""

from __future__ import annotations

from typing import Any

from mpvi_bt.executive.drawing.endings import is_plan
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.prepare import Prepared


def unscored_result(config: EpisodeConfig, prepared: Prepared, outcome: Outcome) -> dict[str, Any]:
    """The result as data for JSON."""
    failures = [*outcome.log.failures, *filter(None, [outcome.failure])]
    return {
        "tree": prepared.spec.name,
        "plan": is_plan(prepared.spec),
        "success": outcome.ending == "success",
        "ended": outcome.ending,
        "ticks": outcome.ticks,
        "time": {"simulator_time": outcome.time_s},
        "failures": [
            {"node": f.path, "reason": f.reason, "feedback": f.evidence, "time_s": f.time_s} for f in failures
        ],
        "replans": [
            {"node": r.path, "segments": r.segments, "said": r.said, "time_s": r.time_s} for r in outcome.log.replans
        ],
        "trace": str(config.trace) if config.trace else None,
    }
