"""A folder of results knows which suite they are of, whatever has become of the suite's file."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import other_run, write_result
from mpvi_bt.runs.report.suite_folders import SuiteFolder
from mpvi_bt.runs.report.suite_report import SuiteReport
from mpvi_bt.runs.suite.manifest import FILE, make_manifest
from mpvi_bt.runs.suite.runner import run_suite
from mpvi_bt.runs.suite.store import Store
from mpvi_bt.runs.suite.suites import load_suite
from tests.fake_episodes import fake_result
from tests.suite_runs import EPISODES, FAKE, Heard, processes

SUITE = "about: Of my own.\nmethods: [{}]\ntasks: [picking_up_trash]\ninstances: [0, 1]\n"


def kept(out: Path, suite: str = "trash10", policy: str = "expert") -> Store:
    """A folder with three results of ten."""
    store = Store(out)
    episodes = [EpisodeConfig("picking_up_trash", i, policy=policy) for i in range(10)]
    make_manifest(suite, episodes, "Of my own.").claim(out)
    for config in episodes[:3]:
        store.write(config, fake_result(config))
    return store


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_suites_from_files_anywhere_are_compared_by_their_folders(
    tmp_path: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Run from two files that are gone afterwards: folders, names and JSON still tell all, with what the file said."""
    for name, method in (("mine", "expert"), ("yours", "mpvi")):
        file = tmp_path / "files" / f"{name}.yaml"
        file.parent.mkdir(exist_ok=True)
        file.write_text(SUITE.format(method))
        assert run(["suite", "run", str(file), "--episode", FAKE, "--workers", "1", "--no-trace"]) == 0
    shutil.rmtree(tmp_path / "files")
    shutil.move("runs/yours", "elsewhere")
    capsys.readouterr()
    assert run(["suite", "report", "mine", "elsewhere", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["suite"], list(told["methods"])) == ("mine, yours", ["expert", "mpvi"])
    assert told["figures"]["about"] == "Of my own."
    for word in ("mine", "runs/mine", "./runs/mine", str(tmp_path / "runs/mine")):
        assert run(["suite", "status", word]) == 0
        assert capsys.readouterr().out.startswith("mine: 2/2 done, ")


@pytest.mark.parametrize(
    ("there", "word", "meant"),
    [
        (["runs/mine"], "mine", "runs/mine"),
        (["runs/mine", "mine"], "mine", "runs/mine"),
        (["runs/mine", "mine"], "./mine", "mine"),
        (["runs/mine", "old/mine"], "old/mine", "old/mine"),
        (["mine"], "mine", "mine"),
        (["trash10"], "trash10", "trash10"),
        (["trash10", "runs/trash10"], "trash10", "runs/trash10"),
        (["runs/trash10"], "runs/trash10/", "runs/trash10"),
        ([], "trash10", "runs/trash10"),
    ],
)
def test_a_name_finds_the_results_that_are_there(there: list[str], word: str, meant: str) -> None:
    """A path is that folder; a bare name is looked for in `runs`, then here; a suite that was never run is empty."""
    for folder in there:
        kept(Path(folder), Path(folder).name)
    assert SuiteFolder.named(word).store.out == Path(meant)


def test_the_file_of_a_suite_finds_where_its_results_are_put_by_default() -> None:
    """Wherever the file is."""
    kept(Path("runs/mine"), "mine")
    Path("a").mkdir()
    Path("a/mine.yaml").write_text(SUITE.format("expert"))
    part = SuiteFolder.named("a/mine.yaml")
    assert (part.store.out, len(part.results)) == (Path("runs/mine"), 3)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("old", "old: holds results, but no manifest.json, which says of what suite they are. Name the suite or its"),
        ("./runs", "runs: is not the folder of one suite's results. These are: runs/mine, runs/trash10."),
        ("empty", "empty: holds no results of a suite."),
        ("mina", "unknown suite 'mina'. Did you mean 'mine'?"),
        ("trash11", "unknown suite 'trash11'. Did you mean 'trash10'?"),
        ("zzz", "unknown suite 'zzz'. Known: ablation12, ablation6, behavior30, behavior30_expert, behavior50, lear"),
        ("a/gone.yaml", "a/gone.yaml: there is no such file."),
        ("a/mine.yaml", "a/mine.yaml: there is no such file. Results of a suite of that name are in runs/mine."),
        ("old/mina", "old/mina: there is no such file."),
        ("a" * 5000, "unknown suite"),
    ],
)
def test_what_names_no_results_is_told(word: str, said: str) -> None:
    """In one line, with what would be valid."""
    kept(Path("runs/mine"), "mine")
    kept(Path("runs/trash10"))
    (kept(Path("old"), "mine").out / FILE).unlink()
    Path("empty").mkdir()
    with pytest.raises(UserError) as caught:
        SuiteFolder.named(word)
    assert str(caught.value).startswith(said)
    assert str(caught.value).count("trash10") <= 1, "whether it was run or not"


def test_a_suite_is_not_run_by_the_folder_of_its_results(capsys: pytest.CaptureFixture[str]) -> None:
    """What to say instead is told."""
    kept(Path("runs/mine"), "mine")
    assert run(["suite", "run", "runs/mine"]) == 2
    said = capsys.readouterr().err
    assert said == "mpvi: runs/mine: is a folder. Name the suite or its file, and the folder with --out runs/mine.\n"


def test_older_folders_are_told_by_their_suite() -> None:
    """Without a manifest by the suite that --out stands beside; a manifest of before says nothing of what it is for."""
    (kept(Path("old")).out / FILE).unlink()
    assert len(SuiteFolder.named("trash10", Path("old")).results) == 3
    file = kept(Path("older")).out / FILE
    file.write_text(json.dumps({k: v for k, v in json.loads(file.read_text()).items() if k != "about"}))
    assert (len(SuiteFolder.named("older").results), SuiteFolder.named("older").about) == (3, "")


def test_results_of_one_suite_are_not_told_as_those_of_another() -> None:
    """--out beside the name of another suite is a mistake."""
    kept(Path("mine"), "smoke")
    with pytest.raises(UserError, match="holds results of the suite 'smoke', not of 'trash10'"):
        SuiteFolder.named("trash10", Path("mine"))


def test_a_report_needs_no_part_that_took_part() -> None:
    """Results of a policy of another package are told where it is not installed: results say what reads the truth."""
    kept(Path("mine"), policy="expert")
    for file in (Path("mine") / FILE, *Path("mine").glob("json/*.json")):
        file.write_text(file.read_text().replace('"policy": "expert"', '"policy": "not_installed_here:Mine"'))
    for file in Path("mine").glob("json/*.json"):
        data = json.loads(file.read_text())
        del data["digest"]
        file.write_text(json.dumps(data))
    part = SuiteFolder.named("mine")
    assert len(part.results) == 3
    assert SuiteReport.of([part]).figures.methods[0].privileged == ["policy:expert"]


def test_what_a_unit_or_stand_ins_are_made_of_is_told_when_it_changes(tmp_path: Path, log: Path) -> None:
    """Each file that a setting names is part of what the results are of."""
    (tmp_path / "rules.yaml").write_text("- at: '*'\n  take: success\n")
    Store(tmp_path / "out")
    episodes = [EpisodeConfig("picking_up_trash", substitute="rules.yaml", unit="monitored")]
    manifest = make_manifest("s", episodes)
    assert {name.rpartition("/")[2] for name in manifest.files} >= {"rules.yaml", "monitored.yaml"}
    run_suite(EPISODES[:1], Store(tmp_path / "out"), processes(1), Heard(), manifest=manifest)
    (tmp_path / "rules.yaml").write_text("- at: '*'\n  take: failure\n")
    with pytest.raises(UserError, match=r"rules\.yaml has changed"):
        make_manifest("s", episodes).claim(tmp_path / "out")


def test_the_shipped_suites_say_what_they_are_for() -> None:
    """It is kept beside their results."""
    assert make_manifest("smoke", load_suite("smoke").episodes(), load_suite("smoke").about).about


def test_a_result_that_another_run_left_is_known_for_it(tmp_path: Path) -> None:
    """Its other settings are told. The same run replaces its own result without a word."""
    config = EpisodeConfig("picking_up_trash")
    write_result(tmp_path / "one.json", fake_result(config))
    assert other_run(tmp_path / "one.json", config) == ""
    assert other_run(tmp_path / "none.json", config) == ""
    assert other_run(tmp_path / "one.json", replace(config, policy="other")) == f"policy {config.policy!r}"
