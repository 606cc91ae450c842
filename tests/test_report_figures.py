"""What a report computes: comparisons, failures, means, shares of time."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import ConditionRecord, FailureRecord, Result, Score
from mpvi_bt.runs.report.compare import compare
from mpvi_bt.runs.report.failures import count_failures, predicates, reason
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.official import official_summary
from mpvi_bt.runs.report.paper import paper_mean, paper_scores
from mpvi_bt.runs.report.runs import MEASURES, Runs
from mpvi_bt.runs.report.tables import instance_table
from mpvi_bt.runs.suite.store import Fault, Store
from tests.fake_episodes import fake_result
from tests.synthetic_suites import synthetic_runs


def of_q(method: str, scores: dict[tuple[str, int, int], float], steps: int = 900) -> Runs:
    """Runs whose episodes have just these q."""
    results = {}
    for (task, instance, seed), q in scores.items():
        config = EpisodeConfig(task, instance, seed)
        base = Result.model_validate(fake_result(config, steps=steps))
        results[config] = base.model_copy(update={"q_score": Score(final=q)})
    return Runs(method, list(results), results)


def test_pairs_are_of_the_same_task_instance_and_seed() -> None:
    """What only one method has finished is in no pair; wins, ties and losses are the method's."""
    a = of_q("a", {("t", 0, 0): 0.0, ("t", 1, 0): 0.5, ("t", 2, 0): 1.0, ("u", 0, 0): 0.2})
    b = of_q("b", {("t", 0, 0): 0.5, ("t", 1, 0): 0.5, ("t", 2, 0): 0.0, ("t", 2, 1): 1.0, ("v", 0, 0): 1.0})
    found = compare(a, b)
    assert found is not None
    assert set(found.tasks) == {"t"}
    pairs = found.overall
    assert (pairs.pairs, pairs.wins, pairs.ties, pairs.losses) == (3, 1, 1, 1)
    assert [pairs.baseline, pairs.method] == pytest.approx([1 / 2, 1 / 3])
    assert pairs.difference.mean == pytest.approx(-1 / 6)
    assert compare(a, of_q("c", {("w", 0, 0): 1.0})) is None


def test_each_instance_is_told_by_its_number() -> None:
    """Means over its seeds, in order, "-" where it has no result; nothing where there is but one instance."""
    scores = {("t", 7, 0): 1.0, ("t", 2, 0): 0.0, ("t", 2, 1): 1 / 3, ("u", 5, 0): 0.0}
    table = instance_table(figures("s", [of_q("mine", scores)]).methods[0])
    assert table.head == ["task", "2", "5", "7"]
    assert table.rows == [["t", "0.17", "-", "1"], ["u", "-", "0", "-"]]
    assert not instance_table(figures("s", [of_q("mine", {("t", 2, 0): 1.0})]).methods[0]).rows


def test_improvement_counts_tasks_as_the_paper_does() -> None:
    """Gains, equals and regressions are tasks; the improvement is that of the mean over tasks."""
    before = of_q("e2e", {(t, i, 0): q for t, q in (("t", 0.0), ("u", 0.4), ("v", 0.2)) for i in range(2)})
    after = of_q("mpvi", {(t, i, 0): q for t, q in (("t", 0.5), ("u", 0.4), ("v", 0.1)) for i in range(2)})
    found = compare(before, after)
    assert found is not None
    assert (found.gains, found.equal, found.regressions) == (1, 1, 1)
    assert found.relative is not None
    assert found.relative.mean == pytest.approx(1.0 / 0.6 - 1)


def test_efforts_are_compared_where_both_came_equally_far() -> None:
    """Only pairs with the same q above 0: the method there takes half the time, elsewhere as long as it likes."""
    keys = [("t", i, 0) for i in range(4)]
    before = of_q("a", dict(zip(keys, (0.0, 0.5, 1.0, 0.5), strict=True)), steps=1000)
    after = of_q("b", dict(zip(keys, (0.0, 0.5, 1.0, 1.0), strict=True)), steps=500)
    found = compare(before, after)
    assert found is not None
    assert found.matched == 2
    for name in ("time", "normalized time"):
        effort = found.efforts[name]
        assert effort is not None
        assert effort.mean == pytest.approx(-0.5)
    assert found.efforts["base distance"] is not None
    assert found.efforts["base distance"].mean == 0
    apart = compare(of_q("a", {keys[0]: 0.0}), of_q("b", {keys[0]: 0.0}))
    assert apart is not None
    assert apart.matched == 0
    assert set(apart.efforts.values()) == {None}


@pytest.mark.parametrize(
    ("condition", "names"),
    [
        ("inside(can__of__soda.n.01_2, ashcan.n.01_1)", {"inside"}),
        ("not open(cabinet.n.01_1)", {"not open"}),
        ("nextto(a.n.01_1, b.n.05_1) or under(a.n.01_1, b.n.05_1)", {"nextto", "under"}),
        ("exactly 2 bratwurst.n.01: (inside bratwurst.n.01 hinged_jar.n.01_1)", {"inside"}),
        ("some sofa.n.01: (forn (2) (candy_cane.n.01 - candy_cane.n.01) (ontop candy_cane.n.01 sofa.n.01))", {"ontop"}),
        ("some door.n.01: (forall (door.n.01 - door.n.01) (not (open door.n.01)))", {"not open"}),
        ("whatever it is", {"other"}),
    ],
)
def test_predicates_are_told_from_conditions(condition: str, names: set[str]) -> None:
    """However a condition is printed; a negated one has a name of its own."""
    assert predicates(condition) == names


def test_failures_are_counted_by_reason_end_and_predicate() -> None:
    """An episode that fails twice of one reason counts twice among failures, once among episodes."""
    base = Result.model_validate(fake_result(EpisodeConfig("t", 1)))
    failures = [FailureRecord(node="t/1", reason=reason) for reason in ("no_path", "no_path", "")]
    goal = [ConditionRecord(condition="inside(a.n.01_1, b.n.01_1)", satisfied=ok) for ok in (True, False, False)]
    counted = count_failures([base, base.model_copy(update={"failures": failures, "goal": goal})])
    assert counted.reasons == {"no_path": 2, "no reason given": 1, "timeout": 1}
    assert counted.failed_with == {"no_path": 1, "no reason given": 1, "timeout": 1}
    assert counted.ended == {"failure": 2}
    assert counted.unmet == {"inside": 3}
    assert counted.episodes == 2


@pytest.mark.parametrize(
    ("code", "said", "told"),
    [
        ("timeout", "still at until_complete/manipulate (pick: no_grasp), check_complete", "timeout (pick: no_grasp)"),
        ("gave_up", "pick: no_grasp", "gave_up (pick: no_grasp)"),
        ("gave_up", "pick: no_stance (9 candidates: 9 out of reach)", "gave_up (pick: no_stance)"),
        ("gave_up", "done", "gave_up (done)"),
        ("gave_up", 'done; "the cup is in the sink": no, no cup is seen', "gave_up (done)"),
        ("gave_up", 'pick: no_grasp; "a cup is held": no, nothing is', "gave_up (pick: no_grasp)"),
        ("timeout", "still at manipulate#2 (place_in: no_room), check_complete (no)", "timeout (place_in: no_room)"),
        ("gave_up", "learned: missed: closed on nothing 6 times; no", "gave_up (learned: missed)"),
        ("gave_up", "reactive: place_in: not_a_container; no", "gave_up (reactive: place_in: not_a_container)"),
        ("gave_up", "10 of 10, put the book on it: not_held: no hand holds it", "gave_up (not_held)"),
        ("gave_up", "no skill for 'sing'", "gave_up"),
        ("timeout", "at manipulate (reactive: pick: no_grasp (9 tried))", "timeout (reactive: pick: no_grasp)"),
        ("timeout", "still at until_complete/manipulate (done), check_complete (asked 2: no)", "timeout"),
        ("no_path", "manipulate (pick: no_grasp)", "no_path"),
        ("", "", "no reason given"),
    ],
)
def test_a_timeout_is_counted_with_what_the_policy_gave_up_of(code: str, said: str, told: str) -> None:
    """Timeouts alone would tell nobody what to mend."""
    assert reason(FailureRecord(node="a/b", reason=code, feedback=said, time_s=1.0)) == told


def test_every_measure_is_a_mean_over_instances_and_then_tasks() -> None:
    """Computed here once more, the long way; missing episodes count as 0 only where that is said."""
    runs = synthetic_runs("mpvi", 0.6, finished=0.75)
    method = figures("s", [runs]).methods[0]
    for measure in MEASURES:
        means = []
        for task in runs.tasks:
            values = [measure.of(r) for c, r in runs.results.items() if c.task_name == task]
            found = method.tasks[task].measures[measure.key]
            if known := [x for x in values if x is not None]:
                means.append(np.mean(known))
                assert found is not None
                assert found.mean == pytest.approx(means[-1])
            else:
                assert found is None
        overall = method.overall.measures[measure.key]
        assert overall is not None
        assert overall.mean == pytest.approx(np.mean(means))
    q = method.overall.measures["q_score"]
    assert q is not None
    assert method.overall.q_with_missing == pytest.approx(q.mean * 3 / 4)


def test_figures_are_strict_json_whatever_is_missing() -> None:
    """Nothing finished, one method, many methods, an episode that broke."""
    nothing = synthetic_runs("e2e", 0.2, finished=0.0)
    broken = {nothing.episodes[0]: Fault("the worker process died")}
    nothing = Runs(nothing.method, nothing.episodes, {}, broken)
    for runs in ([nothing], [nothing, synthetic_runs("mpvi", 0.6, finished=0.4)], [synthetic_runs("only", 1.0)]):
        data = json.loads(json.dumps(figures("s", runs).data(), allow_nan=False))
        assert [method["name"] for method in data["methods"]] == [run.method for run in runs]
    assert figures("s", [nothing]).methods[0].missing["picking_up_trash_0_0"] == "the worker process died"
    assert figures("s", [nothing]).comparisons == []


def test_shares_of_wall_time_add_up() -> None:
    """Whatever is not counted apart is "other"."""
    method = figures("s", [synthetic_runs("mpvi", 0.6)]).methods[0]
    assert sum(method.wall.values()) == pytest.approx(1)
    assert method.wall["physics"] == pytest.approx(9 / 20)
    assert method.wall["planning"] == pytest.approx(1 / 20)
    assert method.wall["other"] == pytest.approx(2 / 20)
    assert method.wall_s == pytest.approx(20)


def test_the_baseline_is_a_method() -> None:
    """e2e if it is among them, else the first; another if it is named; a name that is none is refused."""
    runs = [synthetic_runs(name, 0.5) for name in ("mpvi", "e2e", "no_trigger")]
    assert figures("s", runs).baseline == "e2e"
    assert figures("s", runs[::2]).baseline == "mpvi"
    assert [c.method for c in figures("s", runs, baseline="no_trigger").comparisons] == ["mpvi", "e2e"]
    with pytest.raises(UnknownName, match="Did you mean 'mpvi'"):
        figures("s", runs, baseline="mpv")


def test_the_official_summary_is_the_evaluators() -> None:
    """Sums over the rollouts that are there, over all that are to be: the same q as with missing episodes as 0."""
    runs = synthetic_runs("mpvi", 0.6, finished=0.6)
    summary, overall = official_summary(runs), figures("s", [runs]).methods[0].overall
    assert summary["overall_scores"]["q_score"] == pytest.approx(overall.q_with_missing)
    assert summary["overall_scores"].keys() == {
        "q_score", "task_sr", "time_score", "base_distance_score", "left_distance_score", "right_distance_score",
    }  # fmt: skip
    done = [r for r in runs.results.values() if r.task == "hiding_Easter_eggs"]
    times = [r.time.normalized_time or 0.0 for r in done]
    assert summary["per_task_scores"]["time_score"]["hiding_Easter_eggs"] == pytest.approx(sum(times) / 3)
    assert summary["per_task_scores"]["q_score"]["tidying_bedroom"] == 0
    assert summary["per_rollout_scores"]["q_score"]["picking_up_trash"].keys() == {"0_0", "1_0", "2_0"}
    assert summary["per_rollout_scores"]["q_score"]["tidying_bedroom"] == {}


def test_every_measure_is_documented() -> None:
    """docs/reports.md names each with which way is better, and no other."""
    page = (Path(__file__).parent.parent / "docs" / "reports.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .* \| (higher|lower) \|$", page, re.MULTILINE)
    assert rows == [(measure.key, measure.better) for measure in MEASURES]


def test_the_example_of_the_document_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It writes the page of the results that are there."""
    monkeypatch.chdir(tmp_path)
    store = Store(tmp_path / "runs" / "trash10")
    for instance in range(2):
        config = EpisodeConfig("picking_up_trash", instance)
        store.write(config, fake_result(config))
    page = (Path(__file__).parent.parent / "docs" / "reports.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert example is not None
    exec(example[1], {})
    assert "2 of 10 episodes have a result" in (tmp_path / "trash10.html").read_text(encoding="utf-8")


def test_the_papers_figures_are_as_printed() -> None:
    """50 tasks for two methods, 12 for the others; its counts of gains, equals and regressions come out."""
    scores = paper_scores()
    assert {method: len(of) for method, of in scores.items()} == {
        "e2e": 50, "mpvi": 50, "oracle_localization": 12, "subtask_prediction": 12, "no_trigger": 12,
    }  # fmt: skip
    changes = np.array([scores["mpvi"][task] - q for task, q in scores["e2e"].items()])
    assert [(changes > 0).sum(), (changes == 0).sum(), (changes < 0).sum()] == [31, 16, 3]
    assert paper_mean("mpvi", ["picking_up_trash", "bringing_water"]) == pytest.approx(0.8)
    assert paper_mean("no_trigger", ["picking_up_trash", "can_meat"]) is None
    assert paper_mean("mine", ["picking_up_trash"]) is None
