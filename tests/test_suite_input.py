"""What is wrong with a suite or the folder of its results is told in one line, and costs nothing that is there."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.suite.manifest import make_manifest, read_manifest
from mpvi_bt.runs.suite.runner import run_suite
from mpvi_bt.runs.suite.store import Fault, Store
from mpvi_bt.runs.suite.suites import load_suite
from tests.conftest import Shell
from tests.fake_episodes import fake_result
from tests.suite_runs import EPISODES, Heard, launch, processes

METHODS = "methods: [expert, mpvi]\ntasks: [picking_up_trash]\ninstances: [0, 1]\n"


def ended(run: subprocess.Popen[str]) -> tuple[int, str, list[str]]:
    """Exit code, what it printed, and the last lines of what it said."""
    text, said = run.communicate(timeout=120)
    assert "Traceback" not in said
    return run.returncode, text, said.splitlines()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 48 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=48k", "none", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small disk takes rights")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


@pytest.mark.rare
@pytest.mark.slow
def test_results_of_several_methods_do_not_collide(tmp_path: Path, log: Path, mpvi: Shell) -> None:
    """Each method has its folder, in which files are named as BEHAVIOR's; status and report tell them apart."""
    suite, out = tmp_path / "two.yaml", tmp_path / "out"
    suite.write_text(METHODS)
    code, _, said = ended(launch(out, log, suite=str(suite)))
    assert code == 0, said
    files = sorted(path.relative_to(out).as_posix() for path in out.glob("*/json/*"))
    assert files == [f"{method}/json/picking_up_trash_{i}_0.json" for method in ("expert", "mpvi") for i in (0, 1)]
    assert (
        sorted(path.name for path in out.glob("*/traces/*"))
        == ["picking_up_trash_0_0.jsonl"] * 2 + ["picking_up_trash_1_0.jsonl"] * 2
    )
    configs = [json.loads((out / name).read_text())["config"] for name in files]
    assert [(c["method"], c["policy"]) for c in configs] == [("expert", "expert")] * 2 + [("mpvi", "reactive")] * 2
    assert sum("mpvi picking_up_trash_0_0  q 1.00" in line for line in said) == 1
    status = mpvi("suite", "status", str(suite), "--out", str(out))
    assert status.stdout.splitlines() == [
        "two: 4/4 done, mean q 0.75, 2 reached the goal",
        "  expert: 2/2 done, mean q 0.75, 1 reached the goal",
        "  mpvi: 2/2 done, mean q 0.75, 1 reached the goal",
    ]


@pytest.mark.rare
@pytest.mark.slow
def test_a_part_can_be_played_first_and_the_rest_later(tmp_path: Path, log: Path, mpvi: Shell) -> None:
    """What is left out stays to do; the same folder takes it."""
    out = tmp_path / "out"
    code, _, said = ended(launch(out, log, "--instance", "3", "--instance", "7", "--task", "picking_up_trash"))
    assert code == 0, said
    assert sorted(path.name for path in out.glob("json/*")) == [f"picking_up_trash_{i}_0.json" for i in (3, 7)]
    assert mpvi("suite", "status", "trash10", "--out", str(out)).stdout.startswith("trash10: 2/10 done")
    code, _, said = ended(launch(out, log))
    assert (code, len(list(out.glob("json/*")))) == (0, 10), said
    code, _, said = ended(launch(out, log, "--instance", "11"))
    assert (code, said[-1].partition(" Known")[0]) == (
        2, "mpvi: unknown instance of this suite '11'. Did you mean '1'?",
    )  # fmt: skip


def test_flags_override_methods_and_one_method_can_be_run_alone(tmp_path: Path) -> None:
    """What the command line says holds for all of them."""
    suite = tmp_path / "two.yaml"
    suite.write_text(METHODS)
    loaded = load_suite(str(suite))
    assert [(c.method, c.policy, c.checker) for c in loaded.episodes(checker="oracle")[::2]] == [
        ("expert", "expert", "oracle"),
        ("mpvi", "reactive", "oracle"),
    ]
    assert {(c.method, c.policy) for c in loaded.episodes(method="mine", policy="reactive")} == {("mine", "reactive")}


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("methods: [mpvy]\n", "1:11", "unknown method 'mpvy'. Did you mean 'mpvi'?"),
        ("methods: [mpvi, mpvi]\n", "1:17", "'mpvi' is in methods twice"),
        ("methods: mpvi\n", "1:10", "list"),
    ],
)
def test_what_is_wrong_with_methods_is_placed(tmp_path: Path, text: str, place: str, words: str) -> None:
    """Line, column, and what would be valid."""
    path = tmp_path / "mine.yaml"
    path.write_text(f"{text}tasks: [picking_up_trash]\ninstances: [0]\n")
    with pytest.raises(FileProblems) as caught:
        load_suite(str(path))
    assert f"{path}:{place}: " in str(caught.value)
    assert words in str(caught.value)


def test_a_name_that_stands_there_a_thousand_times_is_looked_up_no_thousand_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That it is repeated is told at once."""
    path = tmp_path / "mine.yaml"
    path.write_text(f"tasks: [{', '.join(['picking_up_trash'] * 1000)}]\ninstances: [0]\n")
    monkeypatch.setattr("mpvi_bt.runs.suite.suites.load_task", lambda name: pytest.fail("looked up"))
    with pytest.raises(FileProblems, match="'picking_up_trash' is in tasks twice"):
        load_suite(str(path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"version": "0.0.1"}, "version was 0.0.1, is "),
        ({"bddl": "3.5.0"}, "bddl was 3.5.0, is "),
        ({"suite": "other"}, "suite was other, is trash10"),
        ({"policy": "reactive"}, "policy was reactive, is expert"),
        ({"files": {"skills/pick.yaml": "0"}}, "skills/pick.yaml has changed"),
        ({"files": {"catalogue entry can_of_soda": "0"}}, "catalogue entry can_of_soda has changed"),
    ],
)
def test_a_folder_of_something_else_is_refused(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    """With the difference, before anything is played or written."""
    now = make_manifest("trash10", EPISODES)
    if "policy" in change:
        change = {"methods": {"": now.methods[""] | change}}
    now.model_copy(update=change).claim(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(UserError, match=r"holds results of something else: .*; choose another --out$") as caught:
        run_suite(EPISODES[:1], Store(tmp_path), processes(1), Heard(), manifest=now)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert {path: path.read_bytes() for path in before} == before
    assert not list(tmp_path.glob("json/*"))


def test_hidden_instances_of_another_secret_are_something_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The secret itself is not in the manifest."""
    hidden = [EpisodeConfig("picking_up_trash", split="hidden")]
    secrets = ["one that nobody knows", "another that nobody knows"]
    for secret in secrets:
        monkeypatch.setenv("MPVI_HIDDEN_SEED", secret)
        manifest = make_manifest("hidden", hidden)
        assert secret not in manifest.model_dump_json()
        if secret == secrets[0]:
            manifest.claim(tmp_path)
            manifest.claim(tmp_path)
        else:
            with pytest.raises(UserError, match="hidden seed has changed"):
                manifest.claim(tmp_path)


def test_a_suite_may_grow(tmp_path: Path) -> None:
    """More tasks, instances and methods leave the results that are there as they are."""
    make_manifest("trash10", EPISODES[:3]).claim(tmp_path)
    other = [EpisodeConfig("putting_shoes_on_rack", method="e2e", policy="reactive")]
    grown = make_manifest("trash10", [*EPISODES, *other])
    grown.claim(tmp_path)
    kept = read_manifest(tmp_path)
    assert kept == grown
    make_manifest("trash10", EPISODES[:3]).claim(tmp_path)
    kept = read_manifest(tmp_path)
    assert kept is not None
    assert kept.methods == grown.methods, "what one run leaves out is still there"
    assert kept.files == grown.files


def test_the_manifest_gives_the_episodes_as_they_were_run(tmp_path: Path, mpvi: Shell) -> None:
    """Status and report need not be told how the suite was run."""
    run = [EpisodeConfig("picking_up_trash", i, checker="oracle") for i in range(10)]
    assert make_manifest("trash10", run).episodes() == run
    store = Store(tmp_path / "runs" / "trash10")
    store.write(run[0], fake_result(run[0]))
    make_manifest("trash10", run).claim(store.out)
    done = mpvi("suite", "status", "trash10")
    assert done.stdout.splitlines()[0] == "trash10: 1/10 done, mean q 1.00, 1 reached the goal"
    for command in ("status", "report"):
        done = mpvi("suite", command, "trash10", "--checker", "visual")
        assert done.returncode == 2
        assert "No such option '--checker'" in done.stderr


@pytest.mark.parametrize("change", [None, {"speed": 1}, {"arguments": [1]}, {"task": "x"}])
def test_a_broken_manifest_is_told(tmp_path: Path, change: dict[str, Any] | None) -> None:
    """It says which results stand beside it, so that it is not just written anew; settings that there are not, too."""
    whole = make_manifest("trash10", EPISODES).model_dump()
    whole["methods"][""].update(change or {})
    (tmp_path / "manifest.json").write_text('{"manifest": 2' if change is None else json.dumps(whole))
    with pytest.raises(UserError, match=r"manifest\.json: is not what a suite of this version wrote"):
        make_manifest("trash10", EPISODES).claim(tmp_path)


def test_results_of_another_version_without_a_manifest_are_refused(tmp_path: Path) -> None:
    """As a folder of results that was copied together."""
    store = Store(tmp_path)
    store.write(EPISODES[0], fake_result(EPISODES[0]) | {"version": "0.0.1"})
    with pytest.raises(UserError, match=r"a result of version 0\.0\.1, this is .*; choose another --out"):
        run_suite(EPISODES[:1], store, processes(1), Heard())


def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a result it is put aside like any file that is none; of a fault it is none; of the manifest it is told."""
    monkeypatch.chdir(tmp_path)
    store = Store(tmp_path / "runs" / "trash10")
    config = EPISODES[0]
    for folder in ("json", "faults"):
        (store.out / folder).mkdir(parents=True)
        os.mkfifo(store.out / folder / f"{config.name}.json")
    assert store.result(config) is None
    assert store.fault(config) is None
    store.write_fault(config, Fault("it broke"))
    assert store.fault(config) == Fault("it broke")
    assert store.quarantine(config) == store.out / "quarantine" / f"{config.name}.json"
    assert not store.path(config).exists()
    assert run(["suite", "status", "trash10"]) == 0
    os.mkfifo(store.out / "manifest.json")
    assert run(["suite", "status", "trash10"]) == 2


@pytest.mark.parametrize("name", ["...yaml", "....yaml", ".hidden.yaml"])
def test_a_suite_cannot_name_a_folder_outside(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder of its results lies in runs/ and is not hidden; neither is that of a method in it."""
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    Path(name).write_text("tasks: [picking_up_trash]\ninstances: [0]\n")
    for command in ("run", "status", "report"):
        assert run(["suite", command, f"./{name}"]) == 2
        assert "rename the file" in capsys.readouterr().err
    Path(name).write_text(Path(paths.find("tasks/methods", "expert")).read_text())
    assert run(["suite", "run", "trash10", "--method", f"./{name}"]) == 2
    assert "rename the file" in capsys.readouterr().err
    (tmp_path / "manifest.json").write_text(
        make_manifest("trash10", EPISODES).model_copy(update={"methods": {"../out": {}}}).model_dump_json()
    )
    assert run(["suite", "status", "trash10", "--out", str(tmp_path)]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "manifest.json"]
    assert [path.name for path in (tmp_path / "in").iterdir()] == [name]


@pytest.mark.rare
def test_a_folder_that_cannot_be_written_is_told_before_an_episode_is_played(tmp_path: Path, log: Path) -> None:
    """One line, exit code 2."""
    (tmp_path / "file").touch()
    code, _, said = ended(launch(tmp_path / "file" / "out", log))
    assert (code, said) == (2, [f"mpvi: {tmp_path}/file/out: cannot be written: not a directory"])
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "json").touch()
    code, _, said = ended(launch(tmp_path / "out", log))
    assert (code, said) == (2, [f"mpvi: {tmp_path}/out/json: cannot be written: file exists"])
    assert not list(log.iterdir())


def test_a_disk_that_is_read_only_is_told(small_disk: Path, log: Path) -> None:
    """One line, exit code 2."""
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    code, _, said = ended(launch(small_disk, log))
    assert (code, said) == (2, [f"mpvi: {small_disk}: cannot be written: read-only file system"])


@pytest.mark.rare
@pytest.mark.slow
def test_a_full_disk_ends_the_suite_and_costs_nothing_that_is_there(small_disk: Path, log: Path) -> None:
    """One line, exit code 3; with more room, the same command goes on."""
    out = small_disk / "out"
    code, _, said = ended(launch(out, log))
    assert code == 3
    assert said[-1].startswith(f"mpvi: {out}/")
    assert said[-1].endswith(": cannot be written: no space left on device")
    store = Store(out)
    there = [config for config in EPISODES if store.result(config) is not None]
    assert 0 < len(there) < 10
    assert {path.name for path in (out / "json").iterdir()} == {f"{config.name}.json" for config in there}
    subprocess.run(["mount", "-o", "remount,size=1m", str(small_disk)], check=True)
    code, text, said = ended(launch(out, log))
    assert code == 0, said
    assert f"10 episodes, {len(there)} already there, {10 - len(there)} to run" in said[0]
    assert "trash10: 10/10 episodes" in text


@pytest.mark.rare
@pytest.mark.slow
def test_a_suite_tells_how_it_stands_while_it_runs(tmp_path: Path, log: Path, mpvi: Shell) -> None:
    """Status and report read what is there; neither is in the way of the run, nor the run in theirs."""
    out = tmp_path / "out"
    run = launch(out, log, FAKE_SLEEP="1")
    first = None
    for _ in range(200):
        first = json.loads(mpvi("suite", "status", "trash10", "--out", str(out), "--json").stdout)
        if first["done"] or run.poll() is not None:
            break
    assert first is not None
    report = mpvi("suite", "report", "trash10", "--out", str(out))
    assert (first["running"], report.returncode) == (True, 0), report.stderr
    assert 0 < first["done"] < 10
    code, text, said = ended(run)
    assert code == 0, said
    assert "trash10: 10/10 episodes" in text


@pytest.mark.rare
@pytest.mark.slow
def test_a_broken_result_file_is_put_aside_and_its_episode_run_again(tmp_path: Path, log: Path) -> None:
    """One line says where to; what is put aside is never overwritten."""
    out = tmp_path / "out"
    for number, said_of in ((1, "picking_up_trash_4_0.json"), (2, "picking_up_trash_4_0.2.json")):
        assert ended(launch(out, log))[0] == 0
        (out / "json" / "picking_up_trash_4_0.json").write_bytes(bytes([number]) * 50)
        code, text, said = ended(launch(out, log))
        assert code == 0
        assert f"its result file is broken; moved to {out}/quarantine/{said_of}, and to run again" in said[1]
        assert "trash10: 10/10 episodes" in text
    assert [path.read_bytes()[0] for path in sorted((out / "quarantine").iterdir())] == [2, 1]
