"""The documents keep up with the code."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.drawing import symbols
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.protocol import SIDES, CameraImage, Proprioception
from mpvi_bt.hands.robots import r1
from tests import warm
from tests.layouts import ACTION_SIZE, BASE, LAYOUT

ROOT = Path(__file__).parent.parent
OBSERVATIONS = (ROOT / "docs" / "observations.md").read_text(encoding="utf-8")
KEYS = re.findall(r"^\| `([^`]+)` \|", OBSERVATIONS, flags=re.MULTILINE)


def test_every_observation_is_documented() -> None:
    """The table names each field of proprioception and of a picture, and no other."""
    felt = {key.removeprefix("proprioception.").removesuffix("[side]") for key in KEYS if key.startswith("propriocep")}
    assert felt == {field.name for field in dataclasses.fields(Proprioception)}
    seen = {key for key in KEYS if "." not in key and "[" not in key} - {"prompt", "command"}
    assert seen == {field.name for field in dataclasses.fields(CameraImage)}


def test_the_action_table_is_the_layout() -> None:
    """Its slices are those of the code, and cover the whole action."""
    slices = [BASE, LAYOUT.torso]
    for side in SIDES:
        slices += [LAYOUT.arm[side], slice(LAYOUT.gripper[side], LAYOUT.gripper[side] + 1)]
    rows = re.findall(r"^\| (\d+)(?::(\d+))? \|", OBSERVATIONS, flags=re.MULTILINE)
    assert [(int(a), int(b or int(a) + 1)) for a, b in rows] == [(s.start, s.stop) for s in slices]
    assert slices[-1].stop == ACTION_SIZE


@pytest.mark.parametrize("camera", r1.CAMERAS.values(), ids=r1.CAMERAS)
def test_camera_sizes_are_documented(camera: Camera) -> None:
    """The document names the picture size of each camera."""
    assert f"{camera.width} x {camera.height}" in OBSERVATIONS


def test_base_speed_is_documented() -> None:
    """The document names the base's greatest speeds."""
    assert "{}, {} and {}".format(*r1.BASE_SPEED) in OBSERVATIONS


TREES = (ROOT / "docs" / "trees.md").read_text(encoding="utf-8")
OWN_NODES = (ROOT / "docs" / "own_nodes.md").read_text(encoding="utf-8")


def test_every_kind_of_node_is_documented() -> None:
    """The table of nodes has each kind once, with its other parameters and its summary."""
    rows = re.findall(r"^\| `(\w+)` \| [^|]* \| ([^|]*)\| ([^|]*) \|$", TREES, flags=re.MULTILINE)
    kinds = {kind: node for kind, node in node_types().items() if node.factory.startswith("mpvi_bt.")}
    assert [kind for kind, _, _ in rows] == list(kinds)
    for kind, keys, summary in rows:
        node = kinds[kind]
        assert set(re.findall(r"`(\w+)`", keys)) == set(node.parameters.model_fields) - {node.headline}
        assert summary == node.summary


def test_the_tree_of_the_reference_is_valid(tmp_path: Path) -> None:
    """Its first example is a tree without problems."""
    example = blocks("yaml", TREES)[0]
    (tmp_path / "example.yaml").write_text(example)
    load_tree(tmp_path / "example.yaml", load_skills())


def blocks(language: str, page: str = OWN_NODES) -> list[str]:
    """The pieces of that language in a page."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)


def test_the_file_of_nodes_of_the_reference_works(tmp_path: Path) -> None:
    """Its file of nodes, beside its tree, is checked and run."""
    (tmp_path / "my_nodes.py").write_text(blocks("python")[0])
    (tmp_path / "signal.yaml").write_text(blocks("yaml")[0])
    done = _mpvi(tmp_path, "check", "signal.yaml")
    assert (done.returncode, done.stdout) == (0, "")
    done = _mpvi(tmp_path, "run", "--dry", "--tree", "./signal.yaml")
    assert done.returncode == 0, done.stderr
    assert "green, 0 to go" in done.stdout


@pytest.mark.parametrize("dry", [True, False])
def test_the_package_of_the_reference_works(tmp_path: Path, dry: bool) -> None:
    """Its files, written out and installed, add a node that is checked and run: a stand-in, or the class itself."""
    _, nodes, waving = blocks("python")
    package = tmp_path / "my_robot"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "nodes.py").write_text(nodes if dry else nodes.replace(", robot=True", ""))
    (package / "waving.py").write_text(waving)
    installed = tmp_path / "my_robot-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my_robot\nVersion: 1.0\n")
    points = blocks("toml")[0].replace('project.entry-points."mpvi_bt.behaviors"', "mpvi_bt.behaviors").replace('"', "")
    (installed / "entry_points.txt").write_text(points)
    tree = tmp_path / "welcome.yaml"
    for guest, code, words in (("Ada", 0, "stand-in" if dry else "waving at Ada"), ("nobody", int(not dry), "")):
        tree.write_text(blocks("yaml")[1].replace("Ada", guest))
        done = _mpvi(tmp_path, "check", "welcome.yaml")
        assert (done.returncode, done.stdout) == (0, "")
        done = _mpvi(tmp_path, "run", "--dry", "--tree", "./welcome.yaml")
        assert done.returncode == code, done.stderr
        assert (words or ("stand-in" if dry else "nobody_there: the kitchen is empty")) in done.stdout


def _mpvi(folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; sys.path.insert(0, ''); from mpvi_bt.apps.cli import main; main()"
    return warm.python("-c", code, *args, cwd=folder)


def test_every_sign_of_a_drawing_is_explained() -> None:
    """The legend has each glyph of ours once, with its sign beyond ASCII, and every mark of a state with its word."""
    rows = re.findall(r"^\| `([^`]+)` \| (?:`([^`]*)`)? ?\|", TREES.partition("## How it is drawn")[2], re.MULTILINE)
    assert dict(rows) == symbols._SIGNS
    assert len(rows) == len(symbols._SIGNS)
    words = " ".join(TREES.split())
    assert all(f"`{mark.ascii}` {mark.word}" in words for mark in symbols.MARKS.values())


EXECUTIVE = (ROOT / "docs" / "executive.md").read_text(encoding="utf-8")
SHOWN = [c for c in re.findall(r"`((?:mpvi|python) [^`]*)`", EXECUTIVE) if "FILE" not in c]
FAILS = {"mpvi run --dry --tree fetch --substitute examples/blocked.yaml --no-watch"}


@pytest.mark.rare
def test_every_wish_is_shown_by_its_command(tmp_path: Path) -> None:
    """The commands of the table run in their order, and only the one that shows a failure ends with 1."""
    for entry in ("trees", "skills", "tasks", "examples", "benchmarks"):
        (tmp_path / entry).symlink_to(ROOT / entry)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    script = "\n".join(f"{command} </dev/null; echo exit $?" for command in SHOWN)
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    codes = [int(code) for code in re.findall(r"^exit (\d+)$", done.stdout, flags=re.MULTILINE)]
    assert len(SHOWN) >= 18
    assert dict(zip(SHOWN, codes, strict=True)) == {command: int(command in FAILS) for command in SHOWN}, done.stderr
