"""`mpvi new robot`: a robot's file from a URDF passes `mpvi check`, or it is said what is left."""

from __future__ import annotations

from pathlib import Path

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
