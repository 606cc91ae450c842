"""Laws of the recording in MCAP, read back by mcap's own reader, and each message by ROS 2 where it is installed."""

from __future__ import annotations

import json
import re
import struct
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mpvi_bt.executive.ticking.loop import Watcher, World, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.recording.mcap_log import McapLog, require_mcap
from mpvi_bt.runs.recording.ros_values import joint_states
from mpvi_bt.runs.suite.play import Kept
from mpvi_bt.testing import scripted_context
from tests.conftest import Shell
from tests.mcap_reading import mcap_rows
from tests.search_views import MadeUpSearch, look, searching
from tests.test_recorders import SKILLS, SPEC, Interrupting, VisibleWorld, watch
from tests.without_library import without

pytest.importorskip("mcap_ros2", reason="needs the extra 'mcap'")

EVERY_STEP = {"/joint_states", "/joint_commands", "/cmd_vel", "/odom"}
PICTURES = {
    "/head/color/image_raw/compressed", "/head/color/camera_info", "/head/depth/image_raw", "/head/depth/camera_info",
}  # fmt: skip


def recovered(file: Path) -> list[tuple[str, int, bytes]]:
    """Topic, log time and data of each message up to where a file breaks off, if it does."""
    from mcap.exceptions import EndOfFile
    from mcap.reader import NonSeekingReader

    found = []
    with file.open("rb") as stream:
        try:
            for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                found.append((channel.topic, message.log_time, message.data))
        except (EndOfFile, struct.error):
            pass
    return found


def matrix(moved: Any) -> np.ndarray:
    """(4, 4) of a `geometry_msgs/Transform`."""
    from scipy.spatial.transform import Rotation

    p, q = moved.translation, moved.rotation
    return kin.transform(Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), (p.x, p.y, p.z))


class Felt(Watcher):
    """Keeps what was felt and told at each step."""

    def __init__(self) -> None:
        self.felt: list[Proprioception] = []
        self.told: list[np.ndarray] = []

    def step(self, tree: Tree, world: World) -> None:
        """Keep it."""
        self.felt.append(world.robot.proprioception())
        self.told.append(world.robot.action)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Felt]:
    """Of two seconds of a search, and what was felt in them."""
    file, felt, search = tmp_path_factory.mktemp("mcap") / "new" / "run.mcap", Felt(), searching()
    watch(VisibleWorld(), felt, McapLog(file, search.map, search))
    return file, felt


def test_a_recording_tells_of_every_step(recording: tuple[Path, Felt]) -> None:
    """Joints, commands and base at each; pictures, tree and map where they are due; times rise by a step."""
    file, felt = recording
    logged = mcap_rows(file)
    assert {*EVERY_STEP, *PICTURES, "/tf", "/map", "/tree/text", "/tree/json", "/rosout"} == logged.keys()
    assert {topic: len(logged[topic]) for topic in EVERY_STEP} == dict.fromkeys(EVERY_STEP, len(felt.felt))
    times = [time for time, _, _ in logged["/joint_states"]]
    assert times == [round(step / 30 * 1e9) for step in range(len(felt.felt))]
    for topic, messages in logged.items():
        assert [time for time, _, _ in messages] == sorted(time for time, _, _ in messages), topic
    for time, _, value in logged["/odom"]:
        assert value.header.stamp.sec * 10**9 + value.header.stamp.nanosec == time


def test_joints_and_base_are_those_that_were_felt(recording: tuple[Path, Felt]) -> None:
    """By the robot's names: torso, arms, and fingers, which together are as far apart as the gripper is open."""
    file, felt = recording
    logged = mcap_rows(file)
    robot = robot_named(felt.felt[0].robot)
    for (_, _, joints), (_, _, told), (_, _, base), body, action in zip(
        *(logged[topic] for topic in ("/joint_states", "/joint_commands", "/odom")), felt.felt, felt.told, strict=True
    ):
        at, targets = (dict(zip(m.name, m.position, strict=True)) for m in (joints, told))
        for side in robot.sides:
            assert [at[name] for name in robot.arm_joints[side]] == body.arm[side].tolist()
            assert [targets[name] for name in robot.arm_joints[side]] == action[robot.layout.arm[side]].tolist()
            assert sum(at[name] for name in robot.finger_joints[side]) == pytest.approx(body.gripper_width[side])
        assert [at[name] for name in robot.torso_joints if name] == body.torso.tolist()
        p, v = base.pose.pose.position, base.twist.twist
        assert [p.x, p.y, v.linear.x, v.linear.y, v.angular.z] == [*body.base_pose[:2], *body.base_velocity]
    velocities = [(m.linear.x, m.linear.y, m.angular.z) for _, _, m in logged["/cmd_vel"]]
    assert velocities == [tuple(robot.layout.velocity(action)) for action in felt.told]
    assert any(any(velocity) for velocity in velocities)


def test_a_picture_is_the_one_that_was_seen_where_it_was_seen(tmp_path: Path) -> None:
    """Colors within what JPEG loses, depth in whole millimeters, and the camera through the transforms."""
    search = searching()
    assert search.image is not None
    search.image.rgb[:, 160:] = (200, 60, 20)
    search.image.depth[::2] = 1.2346
    file = tmp_path / "run.mcap"
    watch(VisibleWorld(), McapLog(file, search.map, search))
    logged = mcap_rows(file)
    (time, _, color), (_, _, depth), (_, _, info) = (
        logged[f"/head/{name}"][0] for name in ("color/image_raw/compressed", "depth/image_raw", "depth/camera_info")
    )
    seen = cv2.imdecode(np.frombuffer(color.data, np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None
    assert np.abs(seen[..., ::-1].astype(int) - search.image.rgb).mean() < 1.0
    millimeters = np.frombuffer(depth.data, "<u2").reshape(depth.height, depth.width)
    assert (depth.encoding, depth.step) == ("16UC1", 2 * depth.width)
    assert {*millimeters[::2].ravel()} == {1235}
    assert {*millimeters[1::2].ravel()} == {2000}
    assert np.allclose(np.reshape(info.k, (3, 3)), search.image.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # ROS's zero
    placed = {
        moved.child_frame_id: (moved.header.frame_id, matrix(moved.transform))
        for at, _, message in logged["/tf"]
        if at == time
        for moved in message.transforms
    }
    (above, T_base_camera), (root, T_map_base) = placed[color.header.frame_id], placed["base_link"]
    assert (above, root) == ("base_link", "map")
    assert np.allclose(T_map_base @ T_base_camera, search.image.T_world_camera, atol=1e-9)


def test_a_searched_picture_is_written_once_and_spares_a_rendering(tmp_path: Path) -> None:
    """While it is fresh, half a second; then the head looks five times a second. So do runs that search nothing."""

    def renderings(search: MadeUpSearch | None) -> list[int]:
        file = tmp_path / "run.mcap"
        watch(VisibleWorld(), McapLog(file, None, search))
        return [round(time * 30e-9) for time, _, _ in mcap_rows(file)["/head/color/image_raw/compressed"]]

    every = list(range(0, 61, 6))
    assert renderings(None) == every
    assert renderings(searching()) == [0, *(step for step in every if step > 15)]


def test_the_map_is_written_where_it_changed(tmp_path: Path) -> None:
    """Occupied, free and unknown cells at their places; at most once a second."""
    search = searching()
    search.known = search.known.copy()
    search.known[:, 100:] = False

    class Learning(Watcher):
        """Learns of a column with each step."""

        def step(self, tree: Tree, world: World) -> None:
            """One more."""
            search.known[:, : 100 + world.steps] = True

    file = tmp_path / "run.mcap"
    watch(VisibleWorld(), Learning(), McapLog(file, search.map, search))
    logged = mcap_rows(file)["/map"]
    assert [round(time * 1e-9, 2) for time, _, _ in logged] == [0.0, 1.0, 2.0]
    grid = logged[0][2]
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    row0, column0 = search.map.cell(np.array([grid.info.origin.position.x, grid.info.origin.position.y]) + 1e-6)
    part = slice(row0, row0 + grid.info.height), slice(column0, column0 + grid.info.width)
    columns = np.arange(column0, column0 + grid.info.width)
    assert (cells[:, columns >= 100] == -1).all()
    assert (cells[:, columns < 100] == np.where(search.map.occupied[part][:, columns < 100], 100, 0)).all()
    assert grid.info.resolution == pytest.approx(search.map.resolution_m)


def test_the_tree_and_what_happened_are_told(tmp_path: Path) -> None:
    """Each failure at its step with its reason, each answer of the checker, how it ended, and every node's state."""
    file, world, tree = tmp_path / "run.mcap", VisibleWorld(), Tree(SPEC)
    outcome = run_episode(
        tree, world, scripted_context(world, SKILLS, {}, {}), [McapLog(file, MadeUpSearch().map)], 60.0
    )
    logged = mcap_rows(file)
    told = [(time, line.level, line.name, line.msg) for time, _, line in logged["/rosout"]]
    assert outcome.log.failures
    for failure in outcome.log.failures:
        assert any(
            (time, level, name) == (round(failure.time_s * 1e9), 30, failure.path) and text.startswith(failure.reason)
            for time, level, name, text in told
        ), failure
    assert told[-1][1:] == (40, SPEC.name, outcome.told(SPEC))
    last = json.loads(logged["/tree/json"][-1][2].data)
    assert last["tree"] == SPEC.name
    assert last["nodes"] == {path: state.told() for path, state in tree.states().items()}
    assert SPEC.name in logged["/tree/text"][0][2].data


def test_after_ctrl_c_the_recording_is_whole(tmp_path: Path) -> None:
    """With its index, and the interruption as its last line."""
    file = tmp_path / "run.mcap"
    with pytest.raises(KeyboardInterrupt):
        watch(VisibleWorld(), McapLog(file, MadeUpSearch().map), Interrupting())
    assert "interrupted" in mcap_rows(file)["/rosout"][-1][2].msg


def test_a_killed_run_can_be_read_but_for_its_last_chunk(tmp_path: Path) -> None:
    """Before its file is closed it holds all but the last half MB of messages, whole."""
    file, search = tmp_path / "run.mcap", searching()
    rng = np.random.default_rng(0)
    held: list[bytes] = []

    class Killed(Watcher):
        """Looks at new things all the time; keeps the file as it stands."""

        def step(self, tree: Tree, world: World) -> None:
            """Look, then copy."""
            search.image = look(1, 2, 0)
            search.image.rgb[:] = rng.integers(0, 256, search.image.rgb.shape)
            held.append(file.read_bytes())

    watch(VisibleWorld(), Killed(), McapLog(file, search.map, search))
    whole, cut = recovered(file), tmp_path / "cut.mcap"
    cut.write_bytes(held[-1])
    part = recovered(cut)
    assert part == whole[: len(part)]
    assert sum(len(data) for _, _, data in whole[len(part) :]) < 2**20
    cut.write_bytes(held[-1][: len(held[-1]) // 2])
    half = recovered(cut)
    assert half == whole[: len(half)]
    assert len(half) > len(whole) / 3


def test_a_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    """Before the episode begins, with the path; a full disk is no fault of the user's."""
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"run\.mcap"):
        watch(VisibleWorld(), McapLog(tmp_path / "file" / "run.mcap"))
    with pytest.raises(BackendError, match=r"/dev/full: .*no space left"):
        watch(VisibleWorld(), McapLog("/dev/full"))


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robots_joints_have_their_names(name: str) -> None:
    """Each joint once, none of an arm that it lacks."""
    robot = robot_named(name)
    felt = Proprioception(
        np.zeros(3), np.zeros(3), robot.travel_torso, robot.travel_arm, dict(robot.travel_arm),
        dict.fromkeys(robot.sides, 0.04), dict.fromkeys(robot.sides, 1.0), robot=name,
    )  # fmt: skip
    names = joint_states(0.0, robot, felt)["name"]
    expected = [joint for joint in robot.torso_joints if joint is not None]
    expected += [j for joints in (robot.arm_joints, robot.finger_joints) for side in robot.sides for j in joints[side]]
    assert Counter(names) == Counter(expected)


def test_ros_reads_each_message(recording: tuple[Path, Felt]) -> None:
    """Its own types take it and write the same values again; tf2's are in no wheel, and are read by a test above."""
    serialization = pytest.importorskip("rclpy.serialization", reason="needs ROS 2's Python packages")
    from importlib import import_module

    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    read, factory = set(), DecoderFactory()
    with recording[0].open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            package, _, kind = schema.name.split("/")
            if package == "tf2_msgs":
                continue
            value = serialization.deserialize_message(message.data, getattr(import_module(f"{package}.msg"), kind))
            decode = factory.decoder_for(channel.message_encoding, schema)
            assert decode is not None
            assert decode(serialization.serialize_message(value)) == decode(message.data)
            read.add(channel.topic)
    assert read >= EVERY_STEP | PICTURES | {"/map", "/tree/text", "/tree/json", "/rosout"}


def test_a_suite_records_each_episode_into_its_folder() -> None:
    """A file an episode, named as its result."""
    config = Kept(mcap=True).of(EpisodeConfig("t"), Path("out"))
    assert config.mcap == Path("out/mcap/t_0_0.mcap")
    assert Kept().of(EpisodeConfig("t"), Path("out")).mcap is None


def test_without_the_library_there_is_a_line_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, mpvi: Shell, tmp_path: Path
) -> None:
    """Before anything is set up; and nothing but `--mcap` needs it."""
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    monkeypatch.chdir(tmp_path)  # where the command runs; the clone is named by its path there
    with pytest.raises(UserError, match=re.escape(install("mcap"))):
        require_mcap()
    hidden = without("mcap_ros2", tmp_path)
    done = mpvi("run", "picking_up_trash", "--mcap", "run.mcap", PYTHONPATH=hidden)
    assert done.returncode == 2
    assert done.stderr == f"mpvi: --mcap needs the packages mcap and mcap-ros2-support: {install('mcap')}\n"
    assert not (tmp_path / "run.mcap").exists()
    assert mpvi("run", "--dry", "--tree", "hello", PYTHONPATH=hidden).returncode == 0
