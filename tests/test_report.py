"""What a suite's report and its progress say."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.score import score
from mpvi_bt.executive.drawing.cells import WIDTH
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Grasps, Result
from mpvi_bt.runs.report import closing_table as for_people
from mpvi_bt.runs.report import data as for_programs
from mpvi_bt.runs.report.closing_table import FIGURES, troubles
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.runs import runs_of
from mpvi_bt.runs.suite.at_work import FILE as AT_WORK
from mpvi_bt.runs.suite.at_work import AtWork, note, read
from mpvi_bt.runs.suite.store import Fault, Store
from tests.conftest import Shell
from tests.fake_episodes import fake_result
from tests.synthetic_suites import synthetic_runs

EPISODES = [EpisodeConfig("picking_up_trash", instance) for instance in range(4)]
RESULTS = {c: Result.model_validate(fake_result(c)) for c in EPISODES[:3]}

FAULTS = {EPISODES[3]: Fault("the worker process died (exit code -9)")}


def report_data(name, episodes, results, faults):
    runs = runs_of(episodes, results, faults)
    return for_programs.report_data(figures(name, runs), runs)


def report_text(name, episodes, results, faults, width=WIDTH):
    runs = runs_of(episodes, results, faults)
    return for_people.report_text(figures(name, runs), runs, width)


def test_means_count_missing_episodes_as_zero_and_say_so() -> None:
    """BEHAVIOR's leaderboard does; the mean of the finished ones stands beside it."""
    overall = report_data("four", EPISODES, RESULTS, FAULTS)["overall"]
    assert (overall["episodes"], overall["finished"], overall["successes"]) == (4, 3, 2)
    assert overall["q_score"] == pytest.approx(2.5 / 4)
    assert overall["q_score_of_finished"] == pytest.approx(2.5 / 3)


def test_the_report_for_programs_is_strict_json_without_wall_times() -> None:
    """The same results give the same report, on whatever machine."""
    data = report_data("four", EPISODES, RESULTS, FAULTS)
    assert "wall" not in json.dumps(data, allow_nan=False)
    assert data["missing"] == [{"episode": "picking_up_trash_3_0", "fault": "the worker process died (exit code -9)"}]
    assert data["privileged"] == ["policy:expert"]
    assert set(data["directions"])


def test_episodes_that_the_policys_backend_failed_are_named_and_are_nobodys_score() -> None:
    """Their row says so, so does a line of their own, and the mean of the finished ones leaves them out."""
    faults = {EPISODES[3]: Fault("server_closed: it went away", backend="server_closed")}
    told, words = report_data("four", EPISODES, RESULTS, faults), report_text("four", EPISODES, RESULTS, faults)
    (missing,) = told["missing"]
    assert missing == {
        "episode": "picking_up_trash_3_0", "fault": "server_closed: it went away", "backend": "server_closed",
    }  # fmt: skip
    assert told["overall"]["q_score_of_finished"] == pytest.approx(2.5 / 3)
    assert "backend failure" in words
    assert "instance 3: a backend failed, server_closed: it went away" in words
    assert "failed by a backend, not by the robot: picking_up_trash_3_0" in words


def test_clipped_actions_and_failed_grasps_are_told() -> None:
    """With their numbers; nothing where there were none."""
    assert troubles(0, 0, 0) == ""
    assert troubles(3, 1, 2) == "3 actions clipped, 1 closing on nothing, 2 lost grasps"
    changed = RESULTS[EPISODES[0]].model_copy(update={"clipped": 12, "grasps": Grasps(empty=1)})
    text = report_text("four", EPISODES, {**RESULTS, EPISODES[0]: changed}, FAULTS)
    assert "instance 0: 12 actions clipped, 1 closing on nothing\n" in text


def test_assisted_grasps_are_named_in_every_report() -> None:
    """Of a suite and of one episode; where friction alone holds, nothing is said."""
    assisted = [EpisodeConfig("picking_up_trash", instance, assisted=True) for instance in range(2)]
    results = {c: Result.model_validate(fake_result(c)) for c in assisted}
    assert "assisted grasping" in report_text("two", assisted, results, {})
    assert "assisted" in score(_told(results[assisted[0]]))
    assert "assisted" not in report_text("four", EPISODES, RESULTS, FAULTS)
    assert "assisted" not in score(_told(RESULTS[EPISODES[0]]))


def _told(result: Result) -> dict[str, object]:
    """As `mpvi run` is handed it."""
    return {**result.model_dump(mode="json"), "wall": {"total_s": 2.0, "setup_s": 1.0, "loop": {"stepping": 1.0}}}


def test_a_terminal_obeys_nothing_that_a_model_wrote() -> None:
    """Control characters in feedback are shown as escapes, on one line."""
    failures = [RESULTS[EPISODES[1]].failures[0].model_copy(update={"feedback": "\x1b[2J gone\nnew line"})]
    changed = RESULTS[EPISODES[1]].model_copy(update={"failures": failures})
    words = report_text("four", EPISODES, {**RESULTS, EPISODES[1]: changed}, FAULTS)
    assert "\x1b" not in words
    assert "timeout: \\u001b[2J gone new line" in words


def test_methods_are_told_apart() -> None:
    """A table for each of a task's methods, means of each, and how they compare; nothing is mixed."""
    both = [EpisodeConfig("picking_up_trash", i, method=name) for name in ("e2e", "mpvi") for i in range(4)]
    results = {c: Result.model_validate(fake_result(c)) for c in both if c.method == "mpvi" or c.instance < 2}
    told, words = report_data("two", both, results, {}), report_text("two", both, results, {})
    assert {name: of["overall"]["finished"] for name, of in told["methods"].items()} == {"e2e": 2, "mpvi": 4}
    assert "overall" not in told
    assert [(m["method"], m["episode"]) for m in told["missing"]] == [
        ("e2e", "picking_up_trash_2_0"), ("e2e", "picking_up_trash_3_0"),
    ]  # fmt: skip
    assert told["figures"]["comparisons"][0]["overall"]["pairs"] == 2
    assert "e2e: picking_up_trash\n" in words
    assert "two, mpvi: 4/4 episodes, 2 succeeded, mean q 0.750 [" in words
    assert "mpvi against e2e, on 2 episodes" in words


def test_an_empty_suite_has_no_means() -> None:
    """Nothing done is no score, and no division by zero."""
    data = report_data("four", EPISODES, {}, {})
    assert data["overall"]["q_score"] == 0
    assert data["overall"]["simulator_time"] is None
    assert "0/4 episodes" in report_text("four", EPISODES, {}, {})


def test_the_table_fits_a_terminal_and_tells_everything() -> None:
    """80 columns; every episode's row; failures with their reason; which backends knew the truth."""
    lines = report_text("four", EPISODES, RESULTS, FAULTS).splitlines()
    assert max(map(len, lines)) <= 80
    table = [line for line in lines if line.startswith("  ")]
    rows = [line.split() for line in table if line.split()[0] in "0123"]
    assert [row[2] for row in rows[:4]] == ["1.000", "0.500", "1.000", "-"]
    text = " ".join(" ".join(lines).split())
    assert "machine fault" in text
    assert "instance 1 at 12 s: 2 pick failed, timeout: still reaching" in text
    assert "instance 1 at the end: not met: inside(can, bin)" in text
    assert "four: 3/4 episodes, 2 succeeded, mean q 0.625 with missing ones as 0, 0.833 without" in text
    assert "simulator truth: policy:expert" in text


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_a_report_uses_the_width_of_the_terminal(width: int) -> None:
    """No line is longer; figures end where their head does; those for which there is no room are named."""
    runs = [synthetic_runs(name, share) for name, share in (("e2e", 0.3), ("a_method_of_a_longer_name", 0.8))]
    lines = for_people.report_text(figures("two", runs), runs, width).splitlines()
    assert max(map(len, lines)) <= width
    (head,) = {line for line in lines if line.startswith("  instance  seed")}
    ends = [match.end() for match in re.finditer(r"\S+( m| s)?", head)]
    for line in (line for line in lines if re.match(r"  +(\d|mean) ", line)):
        cells = re.finditer(r"\S+", line[: ends[-2]])
        assert {cell.end() for cell in cells} <= set(ends), line
    text = " ".join(lines)
    left_out = [name for name, _ in FIGURES if name not in head]
    assert (f"Not shown at this width: {', '.join(left_out)}." in text) == bool(left_out)
    assert left_out == [] or width < 160
    assert {60: 2, 80: 5, 100: 6, 160: 10}[width] == len(FIGURES) - len(left_out)


def test_prose_is_wrapped_and_no_unit_is_torn_off() -> None:
    """A percentage stays on one line with its sign; what goes on is farther in."""
    runs = [synthetic_runs(name, share) for name, share in (("e2e", 0.3), ("mpvi", 0.8))]
    for width in range(60, 100):
        lines = for_people.report_text(figures("two", runs), runs, width).splitlines()
        assert not [line for line in lines if re.match(r" *%", line)]


@pytest.mark.rare
def test_status_and_report_read_the_folder(mpvi: Shell, tmp_path: Path) -> None:
    """What is done, what broke and what is to do, for people and for programs."""
    store = Store(tmp_path / "runs" / "trash10")
    for config in EPISODES[:3]:
        store.write(config, fake_result(config))
    store.write_fault(EPISODES[3], FAULTS[EPISODES[3]])
    status = mpvi("suite", "status", "trash10")
    assert status.stdout.splitlines()[0] == "trash10: 3/10 done, mean q 0.83, 2 reached the goal, 1 machine fault"
    assert "picking_up_trash_3_0: machine fault: the worker process died" in status.stdout
    data = json.loads(mpvi("suite", "status", "trash10", "--json").stdout)
    assert (data["done"], len(data["to_do"]), data["running"]) == (3, 7, False)
    report = json.loads(mpvi("suite", "report", "trash10", "--json").stdout)
    assert report["overall"]["finished"] == 3
    assert "3/10 episodes" in mpvi("suite", "report", "trash10").stdout


def test_status_tells_what_each_worker_is_at(mpvi: Shell, tmp_path: Path) -> None:
    """Of a run that is at work, from another process, with the time that is left; of one that was killed nothing."""
    store = Store(tmp_path / "runs" / "trash10")
    for config in EPISODES[:3]:
        store.write(config, fake_result(config))
    note(store.out, [AtWork(worker=2, method="", episode=EPISODES[3].name, since=time.time() - 5)])
    assert "worker" not in mpvi("suite", "status", "trash10").stdout
    with store.locked():
        lines = mpvi("suite", "status", "trash10").stdout.splitlines()
        data = json.loads(mpvi("suite", "status", "trash10", "--json").stdout)
    assert re.match(r"trash10: 3/10 done, \d+ to \d+ (s|min) left, mean q 0.83, 2 reached the goal, a run is", lines[0])
    assert re.fullmatch(r"  worker 2: picking_up_trash_3_0, \d+ s of about \d+ s", lines[1])
    assert [(work["worker"], work["episode"]) for work in data["at_work"]] == [(2, "picking_up_trash_3_0")]
    assert 0 < data["left_s"][0] < data["left_s"][1]


@pytest.mark.parametrize("text", ["", "[", "[1]", '[{"worker": 0}]', "{}", "\x00"])
def test_a_broken_note_of_what_is_at_work_is_none(text: str, tmp_path: Path) -> None:
    """It may be of another version, or of anybody."""
    (tmp_path / AT_WORK).write_text(text)
    assert read(tmp_path) == []


def test_results_of_another_configuration_are_never_mixed_in(mpvi: Shell, tmp_path: Path) -> None:
    """The error names what differs and the way out."""
    Store(tmp_path / "runs" / "trash10").write(EPISODES[0], fake_result(EPISODES[0]))
    done = mpvi("suite", "run", "trash10", "--checker", "oracle")
    assert done.returncode == 2
    assert "a result of another configuration (checker visual); choose another --out" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_folder_in_use_is_refused(mpvi: Shell, tmp_path: Path) -> None:
    """Two runs in one folder would run episodes twice."""
    store = Store(tmp_path / "out")
    with store.locked():
        done = mpvi("suite", "run", "trash10", "--out", str(store.out))
        assert store.running()
    assert not store.running()
    assert done.returncode == 2
    assert "another `mpvi suite run` is at work in this folder" in done.stderr


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["run", "trash11"], "unknown suite 'trash11'. Did you mean 'trash10'?"),
        (["run", "trash10", "--policy", "exprt"], "expert"),
        (["run", "nowhere.yaml"], "nowhere.yaml: there is no such file"),
        (["run", "trash10", "--workers", "0"], "--workers"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(mpvi: Shell, args: list[str], words: str) -> None:
    """What was given and what would be valid, before anything starts."""
    done = mpvi("suite", *args)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
