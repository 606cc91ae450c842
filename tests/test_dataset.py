"""Demonstrations, and the LeRobot datasets made of them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import imageio_ffmpeg
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.apps.cli.dataset import dataset
from mpvi_bt.apps.cli.group import run
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.paths import find
from mpvi_bt.ground.robot.action_rows import state_of
from mpvi_bt.runs.datasets.demonstrations import check_demonstrations, find_demonstrations, read_demonstration
from mpvi_bt.runs.datasets.lerobot import DatasetForm, write_dataset
from mpvi_bt.runs.datasets.normalization import QUANTILES
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder
from tests.demonstrating import Moving, held, recorded, told
from tests.layouts import ACTION_SIZE, CAMERAS, LAYOUT


def test_a_row_has_what_was_felt_at_its_beginning_and_what_was_told_until_the_next(tmp_path: Path) -> None:
    """Ten rows a second: state and pose are of every third step, joint targets of the step before the next."""
    frames = read_demonstration(recorded(tmp_path / "one", 5)).frames
    first = LAYOUT.torso.start
    assert (frames["action"][:, first] - first).tolist() == [200, 500, 800, 1100, 1200]
    assert frames["base_pose"][:, 0].tolist() == [0, 3, 6, 9, 12]
    assert frames["state"].shape == (5, ACTION_SIZE)


def test_the_state_has_the_order_of_the_action() -> None:
    """Where an action commands a joint, the state tells that joint; a gripper's opening stands at its command."""
    felt = Moving().proprioception()
    values = state_of(felt)
    assert (values[LAYOUT.arm["right"]] == felt.arm["right"]).all()
    assert values[LAYOUT.gripper["left"]] == felt.gripper_width["left"]
    assert (values[LAYOUT.torso] == felt.torso).all()


def test_a_row_says_where_cameras_were_against_the_base(tmp_path: Path) -> None:
    """The double's cameras stay at the world's origin while its base drives off and looks elsewhere."""
    frames = read_demonstration(recorded(tmp_path / "one", 3)).frames
    for camera in CAMERAS:
        for pose, T in zip(frames["base_pose"], frames[f"T_base_camera/{camera}"], strict=True):
            assert np.allclose(kin.base(pose) @ T, np.eye(4), atol=1e-6)


def test_pictures_are_taken_only_for_rows(tmp_path: Path) -> None:
    """A picture costs more than all else: none is rendered between rows."""
    tree, world = Tree(load_tree(find("trees", "hello"))), cast("Any", Moving())
    demonstration = DemonstrationRecorder(tmp_path / "one", {}, 10, ("head",))
    demonstration.start(tree, world)
    for world.steps in range(9):
        demonstration.step(tree, world)
    demonstration.end(Outcome("success"))
    assert world.looked == ["head"] * 3


def test_an_episode_that_broke_leaves_no_demonstration(tmp_path: Path) -> None:
    """What a server or a Ctrl-C cut short is no demonstration: no description is written, which comes last."""
    for ending in ("interrupted", "backend_error", "error"):
        tree, world = Tree(load_tree(find("trees", "hello"))), cast("Any", Moving())
        demonstration = DemonstrationRecorder(tmp_path / ending, {}, 10, ())
        demonstration.start(tree, world)
        demonstration.step(tree, world)
        demonstration.end(Outcome(cast("Any", ending)))
        demonstration.conclude(1.0, True)
        with pytest.raises(UserError, match="no demonstration"):
            read_demonstration(tmp_path / ending)


def test_a_dataset_holds_every_row_of_its_episodes(tmp_path: Path) -> None:
    """Rows come out of the tables as they were recorded, numbered through, each with its task."""
    pd = pytest.importorskip("pandas")
    folders = [recorded(tmp_path / f"e{n}", n, instruction=f"Do {n % 2}.") for n in (4, 7, 5)]
    write_dataset([read_demonstration(folder) for folder in folders], tmp_path / "set")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == ("v3.0", 3, 16)
    assert info["total_tasks"] == 2
    episodes = pd.read_parquet(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet")
    tasks = pd.read_parquet(tmp_path / "set/meta/tasks.parquet")
    index = []
    for row, folder in zip(episodes.to_dict("records"), folders, strict=True):
        place = info["data_path"].format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
        table = pd.read_parquet(tmp_path / "set" / place)
        frames = read_demonstration(folder).frames
        for name in ("state", "base_pose", "action"):
            key = name if name == "action" else f"observation.{name}"
            feature = info["features"][key]
            assert (np.stack(table[key]) == frames[name]).all()
            assert feature["shape"] == [len(feature["names"]["motors"])] == [frames[name].shape[1]]
        assert set(table.columns) | {f"observation.images.{c}" for c in CAMERAS} == info["features"].keys()
        assert np.allclose(table["timestamp"], np.arange(len(table)) / 10)
        assert tasks.iloc[table["task_index"][0]].name == read_demonstration(folder).about.instruction
        assert row["dataset_to_index"] - row["dataset_from_index"] == row["length"] == len(table)
        index += table["index"].tolist()
        for camera in CAMERAS:
            key = f"observation.images.{camera}"
            video = info["video_path"].format(
                video_key=key, chunk_index=row[f"videos/{key}/chunk_index"], file_index=row[f"videos/{key}/file_index"]
            )
            assert (tmp_path / "set" / video).stat().st_size > 0
    assert index == list(range(16))


def test_a_videos_frames_are_as_many_as_the_rows_at_their_times(tmp_path: Path) -> None:
    """A loader seeks by time: frame n of the video is the picture of row n."""
    cv2 = pytest.importorskip("cv2")
    recorded(tmp_path / "one", 6)
    video = cv2.VideoCapture(str(tmp_path / "one/head.mp4"))
    shades, times = [], []
    while True:
        there, picture = video.read()
        if not there:
            break
        times.append(video.get(cv2.CAP_PROP_POS_MSEC))
        shades.append(picture.mean())
    assert shades == pytest.approx([0, 8, 16, 24, 32, 40], abs=3)
    assert times == pytest.approx([0, 100, 200, 300, 400, 500], abs=1)


def test_statistics_are_those_of_all_rows_and_pixels(tmp_path: Path) -> None:
    """Normalization takes them: of two episodes together, as numpy has them of what is in the tables."""
    pytest.importorskip("pandas")
    folders = [recorded(tmp_path / f"e{n}", n) for n in (4, 9)]
    write_dataset([read_demonstration(folder) for folder in folders], tmp_path / "set")
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    actions = np.concatenate([read_demonstration(f).frames["action"] for f in folders]).astype(float)
    assert np.allclose(stats["action"]["mean"], actions.mean(0))
    assert np.allclose(stats["action"]["std"], actions.std(0))
    for name, q in QUANTILES.items():
        assert np.allclose(stats["action"][name], np.quantile(actions, q, axis=0))
    shades = np.array([8 * n for count in (4, 9) for n in range(count)]) / 255
    seen = stats["observation.images.head"]
    assert np.allclose(np.ravel(seen["mean"]), shades.mean())
    assert np.allclose(np.ravel(seen["std"]), shades.std())
    assert np.ravel(seen["max"]).tolist() == pytest.approx([shades.max()] * 3)
    assert stats["action"]["count"] == [13] == seen["count"]


def test_only_what_reached_its_goal_is_taken_unless_all_is_asked_for(tmp_path: Path) -> None:
    """A demonstration shows how it is done; what failed comes only by --all."""
    pytest.importorskip("pandas")
    recorded(tmp_path / "demos/good", 3)
    recorded(tmp_path / "demos/bad", 3, q=0.5)
    invoke = CliRunner().invoke
    done = invoke(dataset, [str(tmp_path / "demos"), "--out", str(tmp_path / "set"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["episodes"] == 1
    assert json.loads(done.stdout)["left_out"] == [str(tmp_path / "demos/bad")]
    done = invoke(dataset, [str(tmp_path / "demos"), "--out", str(tmp_path / "all"), "--all"])
    assert "2 episodes, 6 frames" in done.output


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demonstration of three frames by one camera, to spoil copies of."""
    return recorded(tmp_path_factory.mktemp("whole") / "one", 3, cameras=["head"])


def cut(name: str, share: float) -> Callable[[Path], object]:
    """Leave only the first part of a file."""
    return lambda f: os.truncate(f / name, int((f / name).stat().st_size * share))


def filmed(*options: str) -> Callable[[Path], object]:
    """Have ffmpeg write the video anew."""
    return lambda f: (
        subprocess.run(
            [
                imageio_ffmpeg.get_ffmpeg_exe(),
                "-v",
                "error",
                "-y",
                "-i",
                str(f / "head.mp4"),
                *options,
                str(f / "new.mp4"),
            ],
            check=True,
        )
        and (f / "new.mp4").replace(f / "head.mp4")
    )


def pipe(name: str) -> Callable[[Path], object]:
    """Put a pipe in a file's place, which would be waited for for ever."""

    def spoil(folder: Path) -> None:
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return spoil


SPOILED = {
    "cut json": ("episode.json", cut("episode.json", 0.5), "not valid JSON"),
    "empty json": ("episode.json", cut("episode.json", 0), "empty"),
    "list as json": ("episode.json", lambda f: (f / "episode.json").write_text("[]"), "a mapping"),
    "other version": ("episode.json", told(version=99), "version 99; this mpvi_bt reads 1 and 2"),
    "no instruction": ("episode.json", told(instruction=None), "missing key 'instruction'"),
    "empty instruction": ("episode.json", told(instruction=""), "should have 1 character or more"),
    "no subtasks": ("episode.json", told(subtasks=[]), "should have 1 item or more, not 0"),
    "numbered subtask": ("episode.json", told(subtasks=[1]), "text, not 1"),
    "text as frames": ("episode.json", told(frames="3"), "a whole number"),
    "true as frames": ("episode.json", told(frames=True), "a whole number"),
    "no frames": ("episode.json", told(frames=0), "greater than 0, not 0"),
    "no rate": ("episode.json", told(fps=0), "greater than 0, not 0"),
    "text as success": ("episode.json", told(success="yes"), "true or false"),
    "size in words": ("episode.json", told(cameras={"head": "240x320"}), "a list"),
    "half a size": ("episode.json", told(cameras={"head": [240]}), "should have 2 items or more, not 1"),
    "camera elsewhere": ("episode.json", told(cameras={"../../head": [240, 320]}), "pattern"),
    "more rows told": ("frames.npz", told(frames=4), "of shape (3, 23), not (4, 23)"),
    "cut arrays": ("frames.npz", cut("frames.npz", 0.5), "cannot be read"),
    "empty arrays": ("frames.npz", cut("frames.npz", 0), "cannot be read"),
    "one array": ("frames.npz", lambda f: np.save((f / "frames.npz").open("wb"), np.zeros(3)), "cannot be read"),
    "no arrays": ("frames.npz", lambda f: (f / "frames.npz").unlink(), "no such file"),
    "piped arrays": ("frames.npz", pipe("frames.npz"), "no such file"),
    "no actions": ("frames.npz", held(action=None), "no array 'action'"),
    "no histogram": ("frames.npz", held(**{"histogram/head": None}), "no array 'histogram/head'"),
    "narrow state": ("frames.npz", held(state=np.zeros((3, 2), np.float32)), "of shape (3, 2)"),
    "state in words": ("frames.npz", held(state=np.full((3, ACTION_SIZE), "1")), "not floating-point numbers"),
    "objects": ("frames.npz", held(state=np.full((3, ACTION_SIZE), None)), "cannot be read"),
    "endless action": ("frames.npz", held(action=np.full((3, ACTION_SIZE), np.inf, np.float32)), "not finite"),
    "huge action": ("frames.npz", held(action=np.full((3, ACTION_SIZE), 1e300)), "not finite"),
    "subtask too many": ("frames.npz", held(subtask=np.array([0, 0, 1])), "number 1; there are 0 to 0"),
    "subtask below 0": ("frames.npz", held(subtask=np.array([0, -1, 0])), "number -1; there are 0 to 0"),
    "half a subtask": ("frames.npz", held(subtask=np.zeros(3)), "not whole numbers"),
    "other histogram": ("frames.npz", held(**{"histogram/head": np.zeros((3, 256), int)}), "3 pictures of 240 x 320"),
    "no video": ("head.mp4", lambda f: (f / "head.mp4").unlink(), "no such file"),
    "piped video": ("head.mp4", pipe("head.mp4"), "no such file"),
    "empty video": ("head.mp4", cut("head.mp4", 0), "cannot be played to its end"),
    "cut video": ("head.mp4", cut("head.mp4", 0.6), "cannot be played to its end"),
    "no video but text": ("head.mp4", lambda f: (f / "head.mp4").write_text("#EXTM3U"), "cannot be played"),
    "a picture short": ("head.mp4", filmed("-frames:v", "2"), "2 pictures; episode.json says 3 frames"),
    "small pictures": ("head.mp4", filmed("-s", "160x120"), "160x120 pixels; episode.json says 320x240"),
    "other codec": ("head.mp4", filmed("-c:v", "mpeg4"), "encoded as mpeg4"),
    "later pictures": ("head.mp4", filmed("-vf", "setpts=2*PTS", "-fps_mode", "passthrough"), "not 10 a second"),
}  # fmt: skip


@pytest.mark.parametrize("kind", SPOILED)
def test_a_broken_demonstration_is_told_and_nothing_is_written(
    tmp_path: Path, whole: Path, kind: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file and what is wrong with it are named, the exit code is 2, and there is no trace of a dataset."""
    pytest.importorskip("pandas")
    name, spoil, said = SPOILED[kind]
    folder = shutil.copytree(whole, tmp_path / "one")
    spoil(folder)
    monkeypatch.chdir(tmp_path)
    assert run(["dataset", "one", "--out", "set"]) == 2
    lines = capsys.readouterr().err.splitlines()
    first = next(line for line in lines if not line.startswith("checked")).removeprefix("mpvi: ")
    assert first.startswith(f"one/{name}:"), lines
    assert said in first
    assert [path.name for path in tmp_path.iterdir()] == ["one"]


@given(data=st.data())
@settings(max_examples=40)
def test_no_broken_byte_breaks_more_than_an_error(whole: Path, data: st.DataObject) -> None:
    """Whatever is cut off, or overwritten, in whatever file, is found whole or told as a problem of that file."""
    with tempfile.TemporaryDirectory() as place:
        folder = shutil.copytree(whole, Path(place, "one"))
        file = folder / data.draw(st.sampled_from(["episode.json", "frames.npz", "head.mp4"]))
        content = bytearray(file.read_bytes())
        at = data.draw(st.integers(0, len(content)))
        content[at : at + data.draw(st.integers(1, 60))] = data.draw(st.binary(max_size=60))
        file.write_bytes(content)
        try:
            check_demonstrations(find_demonstrations([folder]))
        except FileProblems as error:
            assert {problem.file for problem in error.problems} <= {str(file), str(folder / "frames.npz")}
        except UserError as error:
            assert f"{file}: a demonstration of version" in str(error)


def test_every_broken_episode_is_told_at_once(tmp_path: Path, whole: Path) -> None:
    """One run of the command names all files that have to be mended; an episode that is named twice counts once."""
    for name in ("a", "b", "c"):
        shutil.copytree(whole, tmp_path / "demos" / name)
    (tmp_path / "demos/a/head.mp4").unlink()
    (tmp_path / "demos/c/frames.npz").unlink()
    found = find_demonstrations([tmp_path / "demos", tmp_path / "demos/b"])
    assert [episode.folder.name for episode in found] == ["a", "b", "c"]
    with pytest.raises(FileProblems) as told:
        check_demonstrations(found)
    assert [Path(problem.file).parts[-2:] for problem in told.value.problems] == [
        ("a", "head.mp4"),
        ("c", "frames.npz"),
    ]


def test_episodes_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    """Another rate is another dataset; a folder that exists, or has no demonstrations, is told."""
    pytest.importorskip("pandas")
    slow, fast = recorded(tmp_path / "slow", 3), recorded(tmp_path / "fast", 3, fps=30)
    with pytest.raises(UserError, match=r"fps 10, but .* 30"):
        write_dataset([read_demonstration(fast), read_demonstration(slow)], tmp_path / "set")
    with pytest.raises(UserError, match="exists"):
        write_dataset([read_demonstration(slow)], tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match="no demonstrations there"):
        find_demonstrations([tmp_path / "empty"])
    with pytest.raises(UserError, match="none reached its goal"):
        write_dataset([], tmp_path / "set")


LEROBOTS = {"v3.0": "LEROBOT_PYTHON", "v2.1": "LEROBOT_V21_PYTHON"}


@pytest.mark.parametrize("version", LEROBOTS)
def test_lerobots_own_loader_reads_what_was_recorded(version: Any, tmp_path: Path) -> None:
    """In an environment of its own (it pins an older torch), every row and picture comes out as recorded."""
    if (python := os.environ.get(LEROBOTS[version])) is None:
        pytest.skip(f"{LEROBOTS[version]} names no environment with lerobot")
    folders = [recorded(tmp_path / f"e{n}", n) for n in (12, 9)]
    write_dataset([read_demonstration(folder) for folder in folders], tmp_path / "set", DatasetForm(format=version))
    script = [python, str(Path(__file__).with_name("lerobot_loader.py")), str(tmp_path / "set")]
    done = subprocess.run([*script, "observation.images.head"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout.splitlines()[-1])
    actions = np.concatenate([read_demonstration(f).frames["action"] for f in folders])
    assert np.array_equal(read["action"], actions)
    assert np.allclose(read["mean"], actions.mean(0))
    assert read["task"] == ["Wave."] * 21
    shades = [8 * n / 255 for count in (12, 9) for n in range(count)]
    assert read["shade"] == pytest.approx(shades, abs=3 / 255)
    assert read["chunk"] == [8, ACTION_SIZE]
