"""`mpvi show ROBOT`: what a robot's file says, as text, as data and as a picture."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.apps.authoring.robot_picture import robot_picture
from mpvi_bt.ground import paths
from mpvi_bt.ground.robot.outermost import reach, tcp_heights
from mpvi_bt.ground.robot.robot_reading import read_robot
from mpvi_bt.ground.robot.robots import robot_named
from tests.conftest import Shell

EXAMPLES = Path(__file__).parent.parent / "examples"
SIX, FOUR = EXAMPLES / "six_joints" / "robot.yaml", EXAMPLES / "four_joints" / "robot.yaml"
GREEN = np.array([0, 140, 105])  # edges of what the head sees

by_file = pytest.mark.parametrize(
    "file", [*paths.files("robots"), SIX, FOUR], ids=lambda file: f"{file.parent.name}/{file.stem}"
)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "fetch",
            [
                "fetch: The Fetch; one arm on a lift, two wheels",
                "base: differential (ahead, back and turning); its frame is that of base_link",
                "  footprint   round, radius 0.288 m; 0.33 m are kept clear with folded arms",
                "  torso_lift_joint (lifts)            0.00    0.39 m    0.50 m/s     0.20",
                "right gripper: opens 10 cm; holds something if 0.3 cm wider than told;",
                "head camera: 320 x 240 px, 85 x 69 degrees, depth 0.02 to 20 m; 1.23 m high and",
                "  21 wrist_roll_joint, 22 gripper_right",
                "wrote fetch.png",
            ],
        ),
        (
            str(SIX),
            [
                "right arm: reaches 1.03 m from its first joint, which is 0.56 m high;",
                "  elbow           -2.85  2.85 rad  1.60 rad/s     2.80",
                "  looking 68 degrees down as it drives; on wrist_camera_optical_frame",
                "  5 elbow, 6 forearm_roll, 7 wrist_flex, 8 wrist_roll, 9 gripper_right",
                "wrote robot.png",
            ],
        ),
    ],
    ids=["name", "file"],
)
def test_a_robot_is_told_in_80_columns_and_drawn(name: str, said: list[str], mpvi: Shell, tmp_path: Path) -> None:
    """By its name, or by its file."""
    done = mpvi("show", name)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert set(said) <= set(lines)
    assert max(len(line) for line in lines if str(EXAMPLES) not in line and "robots/" not in line) <= 80
    assert (tmp_path / said[-1].removeprefix("wrote ")).is_file()


@pytest.mark.parametrize("name", ["r1", "fetch", str(FOUR)])
def test_data_of_a_robot_are_those_of_its_description(name: str, mpvi: Shell, tmp_path: Path) -> None:
    """Actions, joints and cameras; no picture is written that nobody asked for."""
    done = mpvi("show", name, "--json")
    assert (done.returncode, list(tmp_path.glob("*.png"))) == (0, [])
    told, robot = json.loads(done.stdout), robot_named(name)
    assert tuple(number["name"] for number in told["actions"]["numbers"]) == robot.layout.names
    assert (told["base"]["kind"] == "holonomic") == robot.sideways
    assert told["arms"].keys() == told["grippers"].keys() == robot.arm_joints.keys()
    for side, arm in told["arms"].items():
        assert np.allclose([joint["limits"] for joint in arm["joints"]], robot.arm_limits[side], atol=1e-6)
    poses = robot.camera_poses(robot.travel_torso, robot.travel_arm)
    assert {name: camera["height_m"] for name, camera in told["cameras"].items()} == pytest.approx(
        {name: float(T[2, 3]) for name, T in poses.items()}, abs=1e-6
    )
    assert [camera["size"] for camera in told["cameras"].values()] == [
        [camera.width, camera.height] for camera in robot.cameras.values()
    ]


def test_the_kind_and_rate_of_its_actions_are_told(mpvi: Shell, tmp_path: Path) -> None:
    """As its file says them."""
    shutil.copy(FOUR.with_suffix(".urdf"), tmp_path)
    (tmp_path / "robot.yaml").write_text(FOUR.read_text() + "actions: { kind: velocity, rate_hz: 10 }\n")
    done = mpvi("show", "robot.yaml")
    assert "actions: 6 numbers, 10 times a second: velocities of the base [m/s, rad/s], how\n" in done.stdout
    assert "  fast joints go [rad/s or m/s], grippers -1 closed to 1 open\n" in done.stdout


def test_an_arm_reaches_as_far_as_its_links_are_long() -> None:
    """By the lengths in the URDFs: 5 cm up to the joint that lifts, then 40, 40, 9 and 9.3 cm."""
    assert reach(read_robot(SIX), "right") == pytest.approx(0.05 + 0.40 + 0.40 + 0.09 + 0.093, abs=2e-3)
    assert tcp_heights(read_robot(FOUR), "right") == pytest.approx((0.1, 0.9), abs=1e-6)


def test_no_posture_is_beyond_the_reach() -> None:
    """Of 500 that are drawn by chance."""
    robot, rng = read_robot(paths.find("robots", "fetch")), np.random.default_rng(1)
    limits = robot.arm_limits["right"]
    q = rng.uniform(limits[:, 0], limits[:, 1], (500, len(limits)))
    poses = robot.hands["right"].poses(np.concatenate([np.tile(robot.travel_torso, (500, 1)), q], 1))
    away = np.linalg.norm(poses[-1][:, :3, 3] - poses[-1 - len(limits)][:, :3, 3], axis=1)
    assert away.max() <= reach(robot, "right") + 1e-9


@by_file
def test_every_robot_on_file_is_drawn(file: Path) -> None:
    """With its footprint, its arms and what its head sees, each in its color."""
    robot = read_robot(file)
    picture = robot_picture(robot).astype(int)
    assert picture.shape[1] == 1400
    for color in (
        (110, 70, 150),
        GREEN,
        *({"left": (0, 114, 178), "right": (213, 94, 0)}[side] for side in robot.sides),
    ):
        assert (np.abs(picture - np.array(color)).max(-1) < 30).sum() > 100


def test_a_camera_that_sees_more_is_drawn_wider(tmp_path: Path) -> None:
    """Of two robots that differ in nothing else."""
    shutil.copy(SIX.with_suffix(".urdf"), tmp_path)
    heights = []
    for focal in (190, 380):
        file = tmp_path / f"of_{focal}.yaml"
        file.write_text(SIX.read_text().replace("fx: 190, fy: 190", f"fx: {focal}, fy: {focal}"))
        from_above = robot_picture(read_robot(file)).astype(int)[:, 700:]
        rows = np.flatnonzero((np.abs(from_above - GREEN).max(-1) < 30).any(1))
        heights.append(np.ptp(rows))
    assert heights[0] > 1.4 * heights[1]


def test_a_robot_of_meshes_that_are_not_there_is_drawn_by_its_joints(tmp_path: Path) -> None:
    """Black lines from link to link stand for its shapes."""
    urdf = SIX.with_suffix(".urdf").read_text()
    bare = "\n".join(line for line in urdf.splitlines() if "<visual>" not in line and "<collision>" not in line)
    (tmp_path / "robot.urdf").write_text(bare)
    shutil.copy(SIX, tmp_path)
    dark = [(robot_picture(read_robot(file)).max(-1) < 80).sum() for file in (SIX, tmp_path / "robot.yaml")]
    assert dark[1] > dark[0] + 500
