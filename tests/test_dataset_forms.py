"""Datasets in LeRobot's two formats, as BEHAVIOR's demonstrations are, with pictures of one size, told by subtasks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground.errors import UserError
from mpvi_bt.hands.behavior_robot.behavior_layout import FIELDS
from mpvi_bt.runs.datasets.demonstrations import check_demonstrations, read_demonstration
from mpvi_bt.runs.datasets.lerobot import DatasetForm, write_dataset
from tests.demonstrating import held, recorded, told

pd = pytest.importorskip("pandas")
STATE = FIELDS["behavior-2025"]


def read_lines(file: Path) -> list[Any]:
    """The values of a JSON Lines file."""
    return [json.loads(line) for line in file.read_text().splitlines()]


def spoiled(folder: Path, *changes: Any) -> Path:
    """A recording of which something was changed."""
    for change in changes:
        change(folder)
    return folder


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Two recordings of our r1; in the first it is at two subtasks."""
    folder = tmp_path_factory.mktemp("own")
    two = [told(subtasks=["go to the can", ""]), held(subtask=np.array([0, 0, 1, 1]))]
    return [spoiled(recorded(folder / "a", 4), *two), recorded(folder / "b", 3)]


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Recordings of an r1pro at 30 Hz: two of one of BEHAVIOR's tasks around one of another."""
    folder = tmp_path_factory.mktemp("theirs")
    tasks = ["picking_up_trash", "turning_on_radio", "picking_up_trash"]
    return [
        spoiled(
            recorded(folder / f"e{n}", 4, fps=30, robot="r1pro", problem=task, instruction=f"Do {task}."),
            told(subtasks=["go to the can", ""]),
            held(subtask=np.array([0, 0, 1, 1])),
        )
        for n, task in enumerate(tasks)
    ]


def written(folders: Sequence[Path], out: Path, **form: Any) -> dict[str, Any]:
    """Write a dataset of recordings; what its `info.json` says."""
    write_dataset([read_demonstration(folder) for folder in folders], out, DatasetForm(**form))
    info: dict[str, Any] = json.loads((out / "meta/info.json").read_text())
    return info


def test_v21_holds_every_row_where_its_templates_say(own: Sequence[Path], tmp_path: Path) -> None:
    """Each episode's table and videos lie where `info.json` says, rows as recorded, types as its features say."""
    info = written(own, tmp_path / "set", format="v2.1")
    assert (info["codebase_version"], info["robot_type"], info["total_videos"]) == ("v2.1", "r1", 6)
    assert [line["length"] for line in read_lines(tmp_path / "set/meta/episodes.jsonl")] == [4, 3]
    assert read_lines(tmp_path / "set/meta/tasks.jsonl") == [{"task_index": 0, "task": "Wave."}]
    index = []
    for n, folder in enumerate(own):
        where = {"episode_chunk": n // info["chunks_size"], "episode_index": n}
        table = pd.read_parquet(tmp_path / "set" / info["data_path"].format(**where))
        assert (np.stack(table["action"]) == read_demonstration(folder).frames["action"]).all()
        assert np.allclose(table["timestamp"], np.arange(len(table)) / info["fps"])
        index += table["index"].tolist()
        videos = {key for key, feature in info["features"].items() if feature["dtype"] == "video"}
        for key in videos:
            assert (tmp_path / "set" / info["video_path"].format(video_key=key, **where)).stat().st_size > 0
        assert {*table.columns} | videos == info["features"].keys()
        for key in table.columns:
            kind = table[key][0].dtype if table[key].dtype == object else table[key].dtype
            assert kind == info["features"][key]["dtype"], key
    assert index == list(range(7))


def test_v21_tells_of_each_episode_what_it_is_normalized_by(own: Sequence[Path], tmp_path: Path) -> None:
    """A loader of that format puts statistics of episodes together: they have the shapes that it asserts."""
    info = written(own, tmp_path / "set", format="v2.1")
    lines = read_lines(tmp_path / "set/meta/episodes_stats.jsonl")
    for line, folder in zip(lines, own, strict=True):
        assert line["stats"].keys() == info["features"].keys()
        actions = read_demonstration(folder).frames["action"].astype(float)
        assert np.allclose(line["stats"]["action"]["mean"], actions.mean(0))
        for key, found in line["stats"].items():
            shape = (3, 1, 1) if "images" in key else tuple(info["features"][key]["shape"])
            assert {np.shape(value) for name, value in found.items() if name != "count"} == {shape}
            assert found["count"] == [len(actions)]


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_a_rows_task_is_its_subtask_where_asked(own: Sequence[Path], tmp_path: Path, version: str) -> None:
    """Rows name what the robot was at, or the instruction where it was at nothing."""
    written(own, tmp_path / "set", format=version, prompt="subtask")
    meta = tmp_path / "set/meta"
    if version == "v2.1":
        names = [line["task"] for line in read_lines(meta / "tasks.jsonl")]
        episodes = read_lines(meta / "episodes.jsonl")
    else:
        names = pd.read_parquet(meta / "tasks.parquet").index.tolist()
        episodes = pd.read_parquet(meta / "episodes").to_dict("records")
    rows = pd.concat(map(pd.read_parquet, sorted((tmp_path / "set/data").rglob("*.parquet"))))
    assert [names[i] for i in rows["task_index"]] == ["go to the can"] * 2 + ["Wave."] * 5
    assert [list(episode["tasks"]) for episode in episodes] == [["go to the can", "Wave."], ["Wave."]]


def test_scaled_pictures_are_of_one_size_and_as_many(own: Sequence[Path], tmp_path: Path) -> None:
    """The tables, the statistics and the videos themselves say so; recordings of that size are copied."""
    cv2 = pytest.importorskip("cv2")
    info = written(own, tmp_path / "set", size=64)
    for camera in ("head", "left", "right"):
        key = f"observation.images.{camera}"
        assert info["features"][key]["shape"] == [64, 64, 3]
        video = cv2.VideoCapture(str(tmp_path / f"set/videos/{key}/chunk-000/file-000.mp4"))
        pictures = [video.read()[1] for _ in range(4)]
        assert not video.read()[0]
        assert {picture.shape for picture in pictures} == {(64, 64, 3)}
        assert [int(picture[32, 32].mean()) for picture in pictures] == pytest.approx([0, 8, 16, 24], abs=3)
    seen = json.loads((tmp_path / "set/meta/stats.json").read_text())["observation.images.left"]
    assert np.ravel(seen["mean"]) == pytest.approx(np.mean([0, 8, 16, 24, 0, 8, 16]) / 255)
    written(own, tmp_path / "alike", size=224)
    same = "videos/observation.images.left/chunk-000/file-000.mp4"
    assert (tmp_path / "alike" / same).read_bytes() == (own[0] / "left.mp4").read_bytes()


def test_like_behavior_has_its_keys_numbers_and_folders(theirs: Sequence[Path], tmp_path: Path) -> None:
    """As the card of its demonstrations has them: tasks by its numbers, episodes numbered by their task."""
    info = written(theirs, tmp_path / "set", format="v2.1", like="behavior")
    assert (info["robot_type"], info["fps"], info["chunks_size"], info["total_tasks"]) == ("R1Pro", 30, 10_000, 2)
    sizes = {key: tuple(feature["shape"]) for key, feature in info["features"].items()}
    assert sizes["observation.state"] == (256,)
    assert sizes["observation.cam_rel_poses"] == (21,)
    assert sizes["observation.images.rgb.left_wrist"] == (224, 224, 3)
    assert sizes["observation.task_info"] == (None,)
    assert info["features"]["timestamp"]["dtype"] == "float64"
    tasks = read_lines(tmp_path / "set/meta/tasks.jsonl")
    assert [(t["task_index"], t["task_name"]) for t in tasks] == [(0, "turning_on_radio"), (1, "picking_up_trash")]
    lines = read_lines(tmp_path / "set/meta/episodes.jsonl")
    assert [line["episode_index"] for line in lines] == [10_000, 0, 10_001]
    assert lines[0]["distance_traveled"] == pytest.approx(3.0)
    for line in lines:
        number, task = line["episode_index"], line["episode_index"] // 10_000
        where = {"episode_chunk": task, "episode_index": number}
        table = pd.read_parquet(tmp_path / "set" / info["data_path"].format(**where))
        assert (table["episode_index"] == number).all()
        assert (table["task_index"] == task).all()
        assert {len(row) for row in table["observation.task_info"]} == {0}
        for place in ("metainfo_path", "annotation_path"):
            assert (tmp_path / "set" / info[place].format(**where)).is_file()
        for camera in ("head", "left_wrist", "right_wrist"):
            video = info["video_path"].format(video_key=f"observation.images.rgb.{camera}", **where)
            assert (tmp_path / "set" / video).stat().st_size > 0
    notes = json.loads((tmp_path / "set" / "annotations/task-0001/episode_00010000.json").read_text())
    told = [(skill["skill_description"], skill["frame_duration"]) for skill in notes["skill_annotation"]]
    assert told == [(["go to the can"], [0, 2]), (["Do picking_up_trash."], [2, 4])]


def test_like_behavior_tells_what_the_robot_felt_and_did(theirs: Sequence[Path], tmp_path: Path) -> None:
    """State and action are what was recorded, where BEHAVIOR has it; the base's action is in its units."""
    written(theirs[:1], tmp_path / "set", like="behavior", base_velocity="world")
    table = pd.read_parquet(tmp_path / "set/data/chunk-000/file-000.parquet")
    state, action = np.stack(table["observation.state"]), np.stack(table["action"])
    frames = read_demonstration(theirs[0]).frames
    assert np.allclose(state[:, STATE["trunk_qpos"]], frames["state"][:, 3:7])
    assert np.allclose(state[:, STATE["arm_left_qpos"]], frames["state"][:, 7:14])
    assert np.allclose(state[:, STATE["arm_right_qvel"]], frames["arm_velocity"][:, 7:])
    assert np.allclose(state[:, STATE["robot_pos"]][:, :2], frames["base_pose"][:, :2])
    assert np.allclose(state[:, STATE["gripper_right_qpos"]], 0.01)
    assert np.allclose(action[:, 3:], frames["action"][:, 3:])
    assert np.allclose(action[:, 0], np.minimum(frames["action"][:, 0] / 0.75, 1))
    assert state[:, STATE["base_qvel"]].any()
    written(theirs[:1], tmp_path / "rest", like="behavior")
    table = pd.read_parquet(tmp_path / "rest/data/chunk-000/file-000.parquet")
    assert not np.stack(table["observation.state"])[:, STATE["base_qvel"]].any()


def test_like_behavior_tells_subtasks_where_comet_reads_them(theirs: Sequence[Path], tmp_path: Path) -> None:
    """The task of a row stays BEHAVIOR's; what the robot was at is in files of the episode's own."""
    written(theirs, tmp_path / "set", format="v2.1", like="behavior", prompt="subtask")
    folder = tmp_path / "set/orchestrators/task-0001/episode_00010001"
    whole = json.loads((folder / "task_annotated.json").read_text())
    assert whole["cot_subtask_description_list"] == ["go to the can", "Do picking_up_trash."]
    second = json.loads((folder / "subtask_1_annotated.json").read_text())
    assert (second["cot_subtask_description"], second["start_frame"], second["end_frame"]) == (
        "Do picking_up_trash.",
        2,
        4,
    )
    assert read_lines(tmp_path / "set/meta/episodes.jsonl")[0]["tasks"] == ["Do picking_up_trash."]


def test_tasks_are_told_in_the_words_of_a_file(
    theirs: Sequence[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Policies that were trained on BEHAVIOR's texts know no others; a task that the file lacks is told."""
    words = {"turning_on_radio": {"task": "Radio on."}, "picking_up_trash": "Trash up."}
    (tmp_path / "words.json").write_text(json.dumps(words))
    given = ["dataset", *map(str, theirs), "--format", "v2.1", "--like", "behavior"]
    assert run([*given, "--out", str(tmp_path / "set"), "--prompts", str(tmp_path / "words.json")]) == 0
    tasks = [line["task"] for line in read_lines(tmp_path / "set/meta/tasks.jsonl")]
    assert tasks == ["Radio on.", "Trash up."]
    (tmp_path / "fewer.json").write_text('{"picking_up_trash": "Trash up."}')
    capsys.readouterr()
    assert run([*given, "--out", str(tmp_path / "no"), "--prompts", str(tmp_path / "fewer.json")]) == 2
    assert "turning_on_radio" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def old(folder: Path) -> None:
    """Make a recording one of version 1."""
    told(version=1)(folder)
    held(arm_velocity=None, **{f"T_base_camera/{camera}": None for camera in ("head", "left", "right")})(folder)


def test_recordings_of_the_version_before_are_read(tmp_path: Path) -> None:
    """They lack joint velocities and where cameras were, which only BEHAVIOR's numbers tell."""
    folder = spoiled(recorded(tmp_path / "one", 3), old)
    check_demonstrations([read_demonstration(folder)])
    assert written([folder], tmp_path / "set")["robot_type"] == "r1"


WRONG: dict[str, tuple[dict[str, Any], Any, dict[str, Any], str]] = {
    "another robot": ({"robot": "r1"}, None, {"like": "behavior"}, "robot r1; BEHAVIOR's numbers are an R1Pro's"),
    "too old": ({}, old, {"like": "behavior"}, "recorded by an older mpvi_bt"),
    "too slow": ({"fps": 10}, None, {"like": "behavior"}, "10 rows a second; BEHAVIOR has 30"),
    "no wrists": ({"cameras": ["head"]}, None, {"like": "behavior"}, "no pictures of left, right"),
    "unknown task": (
        {"problem": "picking_up_trsh"},
        None,
        {"like": "behavior", "format": "v2.1"},
        "unknown task 'picking_up_trsh'. Did you mean 'picking_up_trash'",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_behaviors_is_refused(name: str, tmp_path: Path) -> None:
    """One sentence says of which recording, what it is and what it would have to be; nothing is written."""
    recording, change, form, said = WRONG[name]
    folder = recorded(tmp_path / "one", 2, **{"robot": "r1pro", "fps": 30, **recording})
    if change is not None:
        change(folder)
    with pytest.raises(UserError) as wrong:
        written([folder], tmp_path / "set", **form)
    assert said in str(wrong.value)
    assert str(folder) in str(wrong.value)
    assert [path.name for path in tmp_path.iterdir()] == ["one"]


def test_recordings_that_do_not_go_together_are_refused(own: Sequence[Path], tmp_path: Path) -> None:
    """One robot a dataset; and pictures of one size, unless they are scaled to one."""
    with pytest.raises(UserError, match=r"robot r1pro, but .*: r1"):
        written([own[0], recorded(tmp_path / "other", 2, robot="r1pro")], tmp_path / "set")
    wide = spoiled(recorded(tmp_path / "wide", 2), told(cameras={"head": [100, 100], "left": [9, 9], "right": [9, 9]}))
    with pytest.raises(UserError, match="--size scales all alike"):
        written([own[0], wide], tmp_path / "set")


def test_the_command_makes_each_form(own: Sequence[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its options reach the dataset; a number that no video can have, and names it does not know, are bad usage."""
    out = tmp_path / "set"
    given = ["dataset", str(own[1]), "--out", str(out), "--format", "v2.1", "--size", "32", "--json"]
    assert run(given) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["episodes"], said["format"], said["size"]) == (1, "v2.1", 32)
    assert json.loads((out / "meta/info.json").read_text())["codebase_version"] == "v2.1"
    for wrong in (["--size", "33"], ["--like", "aloha"], ["--format", "v2.0"], ["--prompt", "task"]):
        assert run(["dataset", str(own[1]), "--out", str(tmp_path / "no"), *wrong]) == 2
    assert not (tmp_path / "no").exists()
