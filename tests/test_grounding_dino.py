"""Grounding DINO by transformers: the real loading and reading, on a tiny model with random weights.

What real weights find was not tried: none are downloaded.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.finding.perception.detector import ROBOT, GuardedDetector
from mpvi_bt.finding.perception.grounding_dino import MODEL, GroundingDinoDetector, prompt
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.testing import check_detector
from tests.tiny_grounding_dino import WORDS, write_tiny

installed = all(importlib.util.find_spec(name) for name in ("torch", "transformers"))
needs_it = pytest.mark.skipif(not installed, reason="torch and transformers are the extra grounding-dino")
slow = pytest.mark.slow

HEIGHT, WIDTH = 48, 80


def picture() -> CameraImage:
    rgb = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return CameraImage("head", rgb, np.ones((HEIGHT, WIDTH), np.float32), None, {}, np.eye(3), np.eye(4))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="module")
def detector(folder: Path) -> GroundingDinoDetector:
    return GroundingDinoDetector(str(folder), device="cpu")


def lit(detector: GroundingDinoDetector, *boxes: tuple[str, float, tuple[float, float, float, float]]) -> list[str]:
    """Have the model say boxes: (words, logit, cx cy w h), each lit at the tokens of its words. Returns the prompts."""
    import torch

    asked: list[str] = []

    def say(**inputs: Any) -> Any:
        ids = inputs["input_ids"][0].tolist()
        asked.append(" ".join(WORDS[i] for i in ids))
        logits = torch.full((1, 20, 64), -9.0)
        places = torch.full((1, 20, 4), 0.5)
        for k, (said, logit, place) in enumerate(boxes):
            for i, token in enumerate(ids):
                if WORDS[token] in said.split():
                    logits[0, k, i] = logit
            places[0, k] = torch.tensor(place)
        return SimpleNamespace(logits=logits, pred_boxes=places, input_ids=inputs["input_ids"])

    detector._model = say
    return asked


@pytest.fixture
def scripted(detector: GroundingDinoDetector) -> Any:
    model = detector._model
    yield detector
    detector._model = model


def test_the_prompt_is_as_the_model_was_trained() -> None:
    """Lower case, each phrase ended by a period."""
    assert prompt(["Red cup", "can of soda"]) == "red cup. can of soda."


@slow
@needs_it
def test_it_keeps_the_contract_of_detectors(folder: Path) -> None:
    """With thresholds that let most of what random weights say through; and it says something."""

    def make() -> GroundingDinoDetector:
        return GroundingDinoDetector(str(folder), box_threshold=0.0, text_threshold=0.3, device="cpu")

    check_detector(make, [picture()], ["cup", "the red can on the table", "can of soda"])
    found = GuardedDetector(make()).detect(picture(), ["cup", "the red can on the table", "bowl"])
    assert found
    assert all(d.mask is None for d in found)


@slow
@needs_it
def test_what_the_model_lights_comes_back_under_its_phrase(scripted: GroundingDinoDetector) -> None:
    """Boxes are whole pixels of the picture, scores those of the words; the phrase is as it was asked."""
    asked = lit(scripted, ("red can", 2.0, (0.5, 0.5, 0.25, 0.5)), ("cup", 0.0, (0.1, 0.9, 0.4, 0.4)))
    found = scripted.detect(picture(), ["The cups", "a red can on the table"])
    assert asked == ["[CLS] cup ##s . red can . [SEP]"]
    assert [d.phrase for d in found] == ["a red can on the table", "The cups"]
    np.testing.assert_array_equal(found[0].box, [30, 12, 50, 36])
    np.testing.assert_array_equal(found[1].box, [0, 33, 24, HEIGHT])  # what is beyond the picture's edge is cut off
    np.testing.assert_allclose([d.score for d in found], [1 / (1 + np.exp(-2.0)), 0.5], rtol=1e-5)


@slow
@needs_it
def test_boxes_below_the_threshold_are_dropped(scripted: GroundingDinoDetector) -> None:
    """The box threshold is that of the constructor."""
    lit(scripted, ("cup", -0.7, (0.5, 0.5, 0.2, 0.2)), ("cup", -0.5, (0.2, 0.5, 0.2, 0.2)))
    assert len(scripted.detect(picture(), ["cup"])) == 1  # 0.33 and 0.38, of 0.35


@slow
@needs_it
def test_words_without_a_head_noun_or_of_two_phrases_are_nobodys(scripted: GroundingDinoDetector) -> None:
    """The rule of phrases decides whose a box is."""
    middle = (0.5, 0.5, 0.2, 0.2)
    lit(scripted, ("red", 2.0, middle), ("soda", 2.0, middle), ("trash can", 2.0, middle), (".", 2.0, middle))
    found = scripted.detect(picture(), ["red cup", "can of soda", "trash can"])
    assert [d.phrase for d in found] == ["trash can"]


@slow
@needs_it
def test_phrases_that_say_the_same_are_asked_once(scripted: GroundingDinoDetector) -> None:
    """Each of them gets what was found; the robot and what has no noun are not asked for."""
    asked = lit(scripted, ("cup", 2.0, (0.5, 0.5, 0.2, 0.2)))
    found = scripted.detect(picture(), ["cup", "the cup on the table", ROBOT, "the", "cup"])
    assert asked == ["[CLS] cup . [SEP]"]
    assert [d.phrase for d in found] == ["cup", "the cup on the table"]
    found[0].box[:] = 0
    assert found[1].box.any()


@slow
@needs_it
def test_more_phrases_than_a_text_holds_are_asked_in_several(scripted: GroundingDinoDetector) -> None:
    """No text is longer than the model takes, none is asked twice, and what is too long alone is left out."""
    asked = lit(scripted)
    phrases = [f"{'red ' * k}cup" for k in range(1, 15)] + ["cup " * 70 + "bowl"]
    assert scripted.detect(picture(), phrases) == []
    assert len(asked) == 3
    assert all(len(text.split()) <= 64 for text in asked)
    assert sum(text.count(".") for text in asked) == 14
    asked.clear()
    assert scripted.detect(picture(), []) == []
    assert asked == []


@slow
@needs_it
@pytest.mark.parametrize("older", [True, False])
def test_older_names_of_the_threshold_and_the_words_are_understood(
    scripted: GroundingDinoDetector, older: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Versions of transformers differ in what they call them."""
    import torch

    given: dict[str, float] = {}

    def before(outputs: Any, input_ids: Any, box_threshold: float, text_threshold: float, target_sizes: Any) -> Any:
        given.update(box=box_threshold, text=text_threshold)
        return [{"scores": torch.tensor([0.5]), "boxes": torch.tensor([[1.2, 2.0, 9.0, 8.7]]), "labels": ["cup"]}]

    def since(outputs: Any, input_ids: Any, threshold: float, text_threshold: float, target_sizes: Any) -> Any:
        (result,) = before(outputs, input_ids, threshold, text_threshold, target_sizes)
        return [{**result, "labels": [3], "text_labels": ["cup"]}]

    lit(scripted)
    name = "post_process_grounded_object_detection"
    monkeypatch.setattr(scripted._processor, name, before if older else since, raising=False)
    (found,) = scripted.detect(picture(), ["cup"])
    assert given == {"box": 0.35, "text": 0.25}
    np.testing.assert_array_equal(found.box, [1, 2, 9, 9])


@slow
@needs_it
def test_a_folder_without_a_model_is_refused(tmp_path: Path, folder: Path) -> None:
    """So is one of another kind of model; the message says what to do."""
    for given in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(DetectorError) as caught:
            GroundingDinoDetector(str(given))
        assert caught.value.reason == "not_loaded"
        assert str(given) in str(caught.value)
        assert "hf download" in str(caught.value)


@slow
@needs_it
def test_without_a_network_it_says_what_to_do() -> None:
    """The default model is at a hub: where that cannot be reached the message says how to bring it here."""
    code = (
        "from mpvi_bt.ground.errors import DetectorError\n"
        "from mpvi_bt.finding.perception.grounding_dino import GroundingDinoDetector\n"
        "try:\n    GroundingDinoDetector()\n"
        "except DetectorError as error:\n    print(error.reason, error)\n"
    )
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": "/nowhere"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    said = done.stdout.splitlines()[-1]
    assert said.startswith(f"not_loaded grounding_dino cannot load '{MODEL}'")
    assert "--detector grounding_dino:FOLDER" in said


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither torch nor transformers is loaded before a detector is made."""
    for missing in ("transformers", "torch"):
        monkeypatch.setitem(sys.modules, missing, None)
        with pytest.raises(DetectorError) as caught:
            GroundingDinoDetector()
        assert caught.value.reason == "not_installed"
        assert install("grounding-dino") in str(caught.value)
