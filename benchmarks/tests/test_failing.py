"""Laws of the study of failing policies: how it counts detections, pairs and latencies."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.failing.detection import AGREE, ANY, LASTING, auroc, rows
from benchmarks.failing.intervention import row, undisturbed
from benchmarks.failing.lasting import rows as lasting_rows
from benchmarks.failing.latency import CHUNK, CURVES, STEPS, InChunks, plot
from benchmarks.failing.latency import rows as latency_rows
from benchmarks.failing.own import main as own
from benchmarks.hands.rows import Job, Row, add_row
from mpvi_bt.executive.monitors.calibration import Calibration, Run, SkillThresholds
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.runs.episode.handoffs import Watched

LEVELS: Any = {name: [1.0] for name in SIGNALS}
KNOWN = Calibration(
    policy="expert", robot="r1", alpha=0.1, skills={"pick": SkillThresholds(runs=18, thresholds=LEVELS)}
)


def watched(ended: str, *samples: tuple[float, float, float, float], instance: int = 0) -> Watched:
    return Watched(Run("pick", np.array(samples)), ended, "", ended != "success", "trash", instance)


def test_auroc_is_the_share_of_pairs_in_order() -> None:
    """Ties count half; without both kinds there is none."""
    assert auroc([2, 3], [0, 1]) == 1.0
    assert auroc([1, 0], [1, 0]) == 0.5
    assert auroc([], [1]) is None


def test_a_signal_alone_finds_what_two_in_agreement_do_not() -> None:
    """Found when it first passes its threshold; false alarms are an episode's, of clean handoffs that went well."""
    calm = [watched("success", (0, 0, 0, 0), instance=0), watched("success", (0, 0, 2, 0), instance=1)]
    failing = [watched("failure", (0, 0, 0, 0), (0, 0, 0, 0), (0, 0, 3, 0)), watched("interrupted", (2, 0, 2, 0))]
    table = {str(signal): rest for _, signal, *rest in rows("freeze", KNOWN, failing, calm)}
    assert table["stall"] == [pytest.approx(0.875), (2, 2), 0.5, 0.5]
    assert table["reversals"][1:] == [(1, 2), 0.0, 0.0]
    assert table[AGREE][1:] == [(1, 2), 0.0, 0.0]
    assert table[ANY][1:] == [(2, 2), 0.5, 0.5]
    assert table[LASTING][1:] == [(1, 2), 0.0, 0.0]
    assert table["grip"] == [0.5, (0, 2), None, 0.0]


def result(q: float, *handoffs: tuple[str, str]) -> Any:
    taken = SimpleNamespace(simulator_time=100.0 - 40 * q)
    return SimpleNamespace(q=q, time=taken, handoffs=[{"path": path, "reason": reason} for path, reason in handoffs])


def test_only_pairs_count_and_each_task_as_much_as_another() -> None:
    """q of instances that both arms have, averaged over tasks; what is won back is a share of the cost."""
    without = {("a", 0): result(0.0), ("a", 1): result(1.0), ("b", 0): result(0.0), ("b", 1): result(0.0)}
    with_ = {**without, ("a", 0): result(1.0, ("unit/hand over", "alarm"), ("again from another place/x", ""))}
    del with_["b", 1]
    name, pairs, before, after, _, won, before_s, after_s, alarms, again = row("freeze", without, with_, clean_q=0.75)
    assert (name, pairs, before, after) == ("freeze", 3, 0.25, 0.5)
    assert won == "50 %"
    assert (before_s, after_s) == (pytest.approx(260 / 3), pytest.approx(220 / 3))
    assert alarms == again == pytest.approx(1 / 3)
    assert row("clean", without, with_, clean_q=0.75)[5] is None


def test_an_episode_without_alarm_and_failure_needs_no_second_run() -> None:
    """One signal changes nothing where two are needed; two at one time do, and so does a handoff that failed."""

    def played(ended: str, *samples: list[float]) -> Any:
        return SimpleNamespace(handoffs=[{"ended": ended, "skill": "pick", "samples": samples}])

    assert undisturbed(played("success", [2, 0, 0, 0], [0, 0, 2, 0]), KNOWN)
    assert undisturbed(played("interrupted", [0, 0, 9, 0]), KNOWN)
    assert not undisturbed(played("success", [2, 0, 2, 0]), KNOWN)
    assert not undisturbed(played("success", [2, 0, 0, 0]), KNOWN, agree=1)
    assert undisturbed(played("success", *[[0, 0, 2.0, 0]] * 2), KNOWN, alone_s=1.0)
    assert not undisturbed(played("success", *[[0, 0, 2.0, 0]] * 3), KNOWN, alone_s=1.0)
    assert not undisturbed(played("failure", [0, 0, 0, 0]), KNOWN)


def test_what_lasts_is_counted_as_an_alarm_counts_it() -> None:
    """From the first sample past the threshold to the last one without a break; reversals are of no outcome."""
    stalled = Run("pick", np.array([[9, 0, 0, 0], *[[0, 0, 2, 0]] * 4, [0, 0, 0, 0], *[[0, 0, 2, 2]] * 2], float))
    calm = Run("pick", np.zeros((3, 4)))
    assert lasting_rows(KNOWN, [stalled, calm]) == [["grip", (1, 2), 0.5, None], ["stall", (1, 2), 1.5, None]]
    samples = [list(map(float, values)) for values in stalled.samples]
    played: Any = SimpleNamespace(handoffs=[{"ended": "success", "skill": "pick", "samples": samples[1:]}])
    assert not undisturbed(played, KNOWN, agree=3, alone_s=1.5)
    assert undisturbed(played, KNOWN, agree=3, alone_s=2.0)


def test_a_policys_own_failures_are_told_by_thresholds_of_other_trials(tmp_path: Path) -> None:
    """Eight that went well make thresholds; of the tested trials the one that stalls is found, and no other."""
    for name, count in (("before", 8), ("after", 3)):
        for seed in range(count):
            add_row(
                tmp_path / name, Row(Job("pick", "floor", "learned", seed, "tuning"), True, samples=[[0, 0, 0, 0]] * 9)
            )
    stalled = [[0, 0, k / 2, 0] for k in range(9)]
    add_row(tmp_path / "after", Row(Job("pick", "table", "learned", 0, "tuning"), False, "not_held", samples=stalled))
    shown = CliRunner().invoke(own, [str(tmp_path / "before"), str(tmp_path / "after")], catch_exceptions=False).output
    assert "| | stall | 1.00 | 1/1 | 0.5 | 0.00 |" in shown, shown
    assert "| pick | reversals | 0.50 | 0/1 | | 0.00 |" in shown
    too_few = CliRunner().invoke(own, [str(tmp_path / "after"), str(tmp_path / "before")])
    assert "needs 8 handoffs of a skill that went well; there are: pick 3" in too_few.output


def test_without_latency_all_parts_are_the_policy_alone() -> None:
    """One episode stands in both curves; the plot has a bar for each that was played."""
    played = [
        {"steps": d, "late": late, "trigger": trigger, "q": 0.5, "simulated_s": 10.0 + d, "stale": 0.0}
        for late, trigger in CURVES
        for d in STEPS[:2]
        if d or late == "policy alone"
    ]
    table = latency_rows(played)
    assert table[0][2:6] == [0.5] * 4
    assert table[2][2:6] == [None] * 4
    assert plot(table).count("q 0.50") == 8


def test_a_policy_in_chunks_is_asked_for_each_action_with_one_observation() -> None:
    """Four times, then not again until they are carried out."""
    asked = []

    class Stepwise:
        name, cameras = "stepwise", ()

        def reset(self) -> None: ...

        def infer(self, observation: Any) -> Any:
            asked.append(observation["prompt"])
            return np.full((1, 23), float(len(asked)))

    chunk = InChunks(Stepwise()).infer({"prompt": "pick up the cup"})
    assert (chunk[:, 0] == np.arange(1, CHUNK + 1)).all()
    assert len(asked) == CHUNK
