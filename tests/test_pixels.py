"""Episodes whose eyes see pixels: no picture in them has a label of the renderer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.apps.cli.score import score
from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.perception.learned_checker import LearnedChecker
from mpvi_bt.finding.perception.segments import Segments
from mpvi_bt.finding.perception.shared_eyes import Eyes
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.kind_words import kind_words
from mpvi_bt.runs.choices import learned_eyes
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.learned_eyes import eyes_by
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.testing import check_checker, check_detector
from tests.small_house import placed, small_world

TREE = """
tree: t
root:
  selector: search, then work
  memory: true
  children:
    - timeout: 4
      child: {navigate: trash can}
    - timeout: 4
      child:
        until_complete:
        children:
          - manipulate: pick up the can of soda
          - check_complete: the can of soda is held in a gripper
"""


class Reddish:
    """A network that takes what is red for a can of soda, and nothing for itself."""

    kinds: tuple[str, ...] = ("can__of__soda.n.01", ROBOT)

    def segment(self, image: CameraImage) -> Segments:
        red, green, _ = np.moveaxis(image.rgb.astype(int), -1, 0)
        labels = (red - green > 80).astype(np.int32)
        return Segments(labels, self.kinds[:1] if labels.any() else (), np.full(int(labels.any()), 0.9))


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[CameraImage]:
    """All pictures that cameras take; the network is `Reddish`."""
    taken: list[CameraImage] = []
    look = Cameras.look

    def noted(self: Cameras, name: str) -> CameraImage:
        taken.append(look(self, name))
        return taken[-1]

    seeing = Eyes(Reddish(), kind_words(load_catalogue()))
    monkeypatch.setattr(learned_eyes, "_made", lambda weights, catalogue: seeing)
    monkeypatch.setattr(Cameras, "look", noted)
    return taken


def play(tmp_path: Path, **changes: Any) -> dict[str, Any]:
    """A few seconds of an episode by the method."""
    (tmp_path / "tree.yaml").write_text(TREE)
    config = EpisodeConfig("picking_up_trash", **{**load_method("mpvi_pixels"), "trigger": "periodic:30"})
    return run(replace(config, tree=str(tmp_path / "tree.yaml"), **changes))


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("map_", ["prior", "online"])
def test_no_picture_of_an_episode_by_pixels_has_labels(looks: list[CameraImage], tmp_path: Path, map_: str) -> None:
    """Whether search, hands or checker look; and the result says so."""
    result = play(tmp_path, map=map_)
    assert {image.camera for image in looks} >= {"head"}
    assert len(looks) > 10
    assert result["queries"]["asked"] > 0
    assert all(image.labels is None and not image.names for image in looks)
    assert result["eyes"] == {"detector": "pixels", "policy": "pixels", "checker": "pixels"}
    assert "eyes      pixels (detector, policy, checker)" in score(result)


@pytest.mark.slow
@pytest.mark.render
def test_one_part_that_reads_labels_has_them_rendered(looks: list[CameraImage], tmp_path: Path) -> None:
    """And the result names that part."""
    result = play(tmp_path, checker="visual")
    assert all(image.labels is not None for image in looks)
    assert result["eyes"]["checker"] == "labels"
    assert "labels of the renderer (checker)" in score(result).replace("\n            ", " ")


@pytest.mark.render
def test_the_network_that_ships_keeps_the_contracts() -> None:
    """By what the cameras of a robot in a room show, without labels."""
    world = small_world({"bin": placed("trash_can", 1.2, 0.0)}, render=True)
    world.settle()
    assert world.cameras is not None
    world.cameras.labels = False
    pictures = [world.robot.look(camera) for camera in ("head", "right")]
    check_detector(lambda: make_detector("learned", {}), pictures, ["trash can", "elephant"])
    checker = LearnedChecker(eyes_by())
    check_checker(checker)
    assert checker.check("the trash can is on the floor", pictures[1]).reason
    assert make_detector("learned", {}).name == "learned"
