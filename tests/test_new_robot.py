"""`mpvi new robot`: a robot's file from a URDF passes `mpvi check`, or it is said what is left."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mpvi_bt
from mpvi_bt.apps.authoring.robot_skeleton import new_robot
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.robot.robot_reading import read_robot
from tests.conftest import Shell

ROOT = Path(__file__).parent.parent
FILES = [
    *(ROOT / "robots" / f"{name}.yaml" for name in ("r1", "r1pro", "fetch")),
    ROOT / "examples/four_joints/robot.yaml",
]
STILL = "head_pan_joint"
SIX = ROOT / "examples" / "six_joints" / "robot.urdf"
URDF = ROOT / "examples" / "four_joints" / "robot.urdf"


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_joints_and_cameras_are_found_in_the_urdf(file: Path, tmp_path: Path) -> None:
    """The written file passes the check, and has the joints and cameras of the file that was written by hand.

    The fetch's own file leaves the pan of its head still.
    """
    (written,) = new_robot("quite_new", file.with_suffix(".urdf"), tmp_path).write(tmp_path)
    assert mpvi_bt.check(written) == []
    found, known = read_robot(written), read_robot(file)
    assert [name for name in found.torso_joints if name != STILL] == [name for name in known.torso_joints if name]
    assert found.arm_joints == known.arm_joints
    assert found.finger_joints == known.finger_joints
    assert found.cameras.keys() == known.cameras.keys()


def test_each_guess_is_said_in_the_file_and_on_the_screen(tmp_path: Path, mpvi: Shell) -> None:
    """The same lines."""
    done = mpvi("new", "robot", "quite_new", "--urdf", str(URDF), "--root", str(tmp_path))
    assert done.returncode == 0, done.stderr
    comments = [line[2:] for line in (tmp_path / "robots/quite_new.yaml").read_text().splitlines() if line[:1] == "#"]
    assert len(comments) > 3
    assert set(comments[1:]) <= set(done.stdout.splitlines())


def without_fingers(folder: Path) -> Path:
    """The URDF of the arm with six joints, its fingers fixed."""
    text = re.sub(r'(<joint name="\w*finger" type=)"prismatic"', r'\1"fixed"', SIX.read_text())
    file = folder / "bare.urdf"
    file.write_text(re.sub(r'<mimic joint="left_finger"/>', "", text))
    return file


def test_an_arm_without_fingers_is_found_by_its_joints(tmp_path: Path) -> None:
    """Such as one whose gripper has a driver of its own: how wide that opens is guessed, and said."""
    made = new_robot("quite_new", without_fingers(tmp_path), tmp_path)
    (written,) = made.write(tmp_path)
    assert mpvi_bt.check(written) == []
    robot = read_robot(written)
    assert robot.arm_joints["right"] == read_robot(SIX.with_suffix(".yaml")).arm_joints["right"]
    assert (robot.finger_joints["right"], robot.opening_m) == ((), 0.08)
    assert any("the URDF has no joint of a finger" in line for line in made.remarks)


def test_a_gripper_without_joints_has_to_say_how_wide_it_opens(tmp_path: Path) -> None:
    """By the line of the gripper."""
    (written,) = new_robot("quite_new", without_fingers(tmp_path), tmp_path).write(tmp_path)
    written.write_text(written.read_text().replace("    opening_m: 0.08\n", ""))
    (problem,) = mpvi_bt.check(written)
    assert "without joints it needs `opening_m`" in problem.message


@pytest.mark.parametrize(
    ("mesh", "scale", "outline"),
    [
        ("box.stl", 0.01, [[0.35, -0.2], [0.35, 0.2], [-0.35, 0.2], [-0.35, -0.2]]),
        ("text.stl", 0.01, [[0.35, -0.2], [0.35, 0.2], [-0.35, 0.2], [-0.35, -0.2]]),
        ("box.obj", 0.01, [[0.35, -0.2], [0.35, 0.2], [-0.35, 0.2], [-0.35, -0.2]]),
        ("box.obj", 0.004, 0.3),
        ("cut.stl", 0.01, 0.3),
        ("no.dae", 0.01, 0.3),
    ],
)
def test_a_footprint_is_that_of_the_meshes_of_the_base(
    mesh: str, scale: float, outline: float | list[list[float]], tmp_path: Path
) -> None:
    """Corners of a box of 70 x 40 cm; where a mesh cannot be read, or is as small as an arm's foot, it is guessed."""
    corners = np.array([[x, y, z] for x in (-35, 35) for y in (-20, 20) for z in (0, 10)], "<f4")
    rows = np.zeros(4, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["corners"] = corners[[[0, 1, 2], [3, 4, 5], [5, 6, 7], [0, 6, 7]]]
    binary = bytes(80) + (4).to_bytes(4, "little") + rows.tobytes()
    (tmp_path / "box.stl").write_bytes(binary)
    (tmp_path / "cut.stl").write_bytes(binary[:-9])
    words = [" ".join(f"{x:.3e}" for x in corner) for corner in corners]
    (tmp_path / "text.stl").write_text("solid box\n" + "".join(f"  vertex {word}\n" for word in words))
    (tmp_path / "box.obj").write_text("".join(f"v {word}\n" for word in words) + "f 1 2 3\n")
    shape = f'<visual><geometry><mesh filename="{mesh}" scale="{scale} {scale} {scale}"/></geometry></visual>'
    link = '<link name="base_link"/><link name="eye_camera"/><joint name="eye" type="fixed">'
    link += '<parent link="base_link"/><child link="eye_camera"/></joint>'
    urdf = tmp_path / "box.urdf"
    urdf.write_text(f'<robot name="box">{link}</robot>'.replace('"base_link"/>', f'"base_link">{shape}</link>', 1))
    (written,) = new_robot("quite_new", urdf, tmp_path).write(tmp_path)
    base = read_robot(written).base
    assert np.allclose(base.corners if len(base.corners) else base.radius_m, outline)


def test_what_is_left_to_fill_in_is_said(tmp_path: Path, mpvi: Shell) -> None:
    """Of a robot whose URDF has no camera: the file is written all the same."""
    bare = tmp_path / "bare.urdf"
    bare.write_text(URDF.read_text().replace("camera_optical_frame", "eye"))
    done = mpvi("new", "robot", "quite_new", "--urdf", str(bare), "--root", str(tmp_path))
    assert done.returncode == 0, done.stderr
    (left,) = [line for line in done.stdout.splitlines() if line.startswith("to be filled in: ")]
    assert "head" in left
    assert (tmp_path / "robots" / "quite_new.yaml").is_file()


def test_a_base_drives_as_it_is_told(tmp_path: Path) -> None:
    """`--base` comes before what wheels tell."""
    (written,) = new_robot("quite_new", URDF, tmp_path, "holonomic").write(tmp_path)
    assert read_robot(written).sideways
    assert mpvi_bt.check(written) == []


def test_wheels_are_told_by_their_links_too(tmp_path: Path) -> None:
    """Of two joints "wl" and "wr" that turn links "wheel_l" and "wheel_r"."""
    wheels = "".join(
        f'<link name="wheel_{side}"/><joint name="w{side}" type="continuous"><parent link="base_link"/>'
        f'<child link="wheel_{side}"/><axis xyz="0 1 0"/></joint>'
        for side in "lr"
    )
    bare = tmp_path / "bare.urdf"
    bare.write_text(f'<robot name="r"><link name="base_link"/>{wheels}</robot>')
    (written,) = new_robot("quite_new", bare, tmp_path).write(tmp_path)
    assert "differential, of 2 joints of wheels" in written.read_text()


def test_xacro_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """With how it is expanded."""
    raw = tmp_path / "raw.urdf"
    raw.write_text(URDF.read_text().replace('size="0.06 0.06 1.0"', 'size="${w} 0.06 1.0"'))
    with pytest.raises(FileProblems, match="expand it"):
        new_robot("quite_new", raw, tmp_path)


def test_robots_are_listed(mpvi: Shell) -> None:
    """By name, each with what its file says about it."""
    lines = dict(line.split(maxsplit=1) for line in mpvi("list", "robots").stdout.splitlines())
    assert {"r1", "r1pro", "fetch"} <= lines.keys()


def test_a_base_frame_above_the_floor_is_told(tmp_path: Path) -> None:
    """As of a walker's hip, below which its legs are."""
    raised = tmp_path / "raised.urdf"
    raised.write_text(SIX.read_text().replace('<origin xyz="0 0 0.17"/>', '<origin xyz="0 0 -0.37"/>'))
    (written,) = new_robot("quite_new", raised, tmp_path).write(tmp_path)
    assert read_robot(written).above_floor_m == pytest.approx(0.37 + 0.13 + 0.01)
    assert mpvi_bt.check(written) == []
