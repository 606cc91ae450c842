"""The documents keep up with the code."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from mpvi_bt.behaviors.registry import node_types
from mpvi_bt.plan.skills import load_skills
from mpvi_bt.robot import r1
from mpvi_bt.robot.protocol import ACTION_SIZE, SIDES, ActionLayout, CameraImage, Proprioception
from mpvi_bt.tree.yaml_io import load_tree

ROOT = Path(__file__).parent.parent
OBSERVATIONS = (ROOT / "docs" / "observations.md").read_text(encoding="utf-8")
KEYS = re.findall(r"^\| `([^`]+)` \|", OBSERVATIONS, flags=re.MULTILINE)


def test_every_observation_is_documented() -> None:
    """The table names each field of proprioception and of a picture, and no other."""
    felt = {key.removeprefix("proprioception.").removesuffix("[side]") for key in KEYS if key.startswith("propriocep")}
    assert felt == {field.name for field in dataclasses.fields(Proprioception)}
    seen = {key for key in KEYS if "." not in key and "[" not in key} - {"prompt"}
    assert seen == {field.name for field in dataclasses.fields(CameraImage)}


def test_the_action_table_is_the_layout() -> None:
    """Its slices are those of the code, and cover the whole action."""
    slices = [ActionLayout.BASE, ActionLayout.TORSO]
    for side in SIDES:
        slices += [ActionLayout.ARM[side], slice(ActionLayout.GRIPPER[side], ActionLayout.GRIPPER[side] + 1)]
    rows = re.findall(r"^\| (\d+)(?::(\d+))? \|", OBSERVATIONS, flags=re.MULTILINE)
    assert [(int(a), int(b or int(a) + 1)) for a, b in rows] == [(s.start, s.stop) for s in slices]
    assert slices[-1].stop == ACTION_SIZE


@pytest.mark.parametrize("camera", r1.CAMERAS.values(), ids=r1.CAMERAS)
def test_camera_sizes_are_documented(camera: r1.Camera) -> None:
    """The document names the picture size of each camera."""
    assert f"{camera.width} x {camera.height}" in OBSERVATIONS


def test_base_speed_is_documented() -> None:
    """The document names the base's greatest speeds."""
    assert "{}, {} and {}".format(*r1.BASE_SPEED) in OBSERVATIONS


TREES = (ROOT / "docs" / "trees.md").read_text(encoding="utf-8")


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
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", TREES, flags=re.MULTILINE | re.DOTALL)
    (tmp_path / "example.yaml").write_text(example)
    load_tree(tmp_path / "example.yaml", load_skills())
