"""Backends of other packages: found by import path or entry point, and checked before an episode begins."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.apps.cli.group import run
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy
from mpvi_bt.runs.episode.prepare import check_backends

CONFIG = EpisodeConfig("picking_up_trash")
MODULE = """
import numpy as np

class Still:
    name, cameras = "still", ()
    def __init__(self, seed, skills=None):
        self.seed = seed
    def reset(self): pass
    def infer(self, observation):
        return np.zeros((1, 23))

class Nameless:
    cameras = ()
    def reset(self): pass
    def infer(self, observation): pass

class Blind:
    name = "blind"
    def detect(self, image, phrases):
        return []

class Needy(Still):
    def __init__(self, weights): pass

class Broken(Still):
    def __init__(self):
        raise OSError("no weights")

class Looking(Still):
    cameras = ("head", "wrist")

class Mute:
    name, cameras = "mute", ()

NUMBER = 3
"""


@pytest.fixture(autouse=True)
def _module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_parts.py").write_text(MODULE)
    (tmp_path / "my_broken_parts.py").write_text("import my_absent_library\n")
    about = tmp_path / "my_parts-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my-parts\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[mpvi_bt.policy]\nstill = my_parts:Still\n")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_parts", raising=False)


def test_parts_of_the_current_folder_are_made() -> None:
    """They are given what they ask for by name, of what is on offer."""
    check_backends(replace(CONFIG, policy="my_parts:Still", detector="my_parts:Blind"))
    policy = make_policy("my_parts:Still", PolicyInputs({}, seed=7))
    assert (policy.name, policy.seed) == ("still", 7)  # type: ignore[attr-defined]
    assert make_detector("my_parts:Blind", {}).name == "blind"


def test_entry_points_are_names(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Of installed packages; they are listed, and suggested."""
    monkeypatch.syspath_prepend(Path.cwd())
    assert make_policy("still", PolicyInputs({})).name == "still"
    assert run(["list", "backends"]) == 0
    assert "--policy still" in capsys.readouterr().out
    with pytest.raises(UserError, match="Did you mean 'still'"):
        check_backends(replace(CONFIG, policy="stil"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("my_part:Still", "there is no module 'my_part', neither in "),
        ("my_parts.more:Still", "there is no module 'my_parts.more'|importing my_parts.more raised"),
        ("my_broken_parts:Still", r"importing my_broken_parts raised .*my_absent_library.*my_broken_parts.py:1"),
        ("my_parts:Stil", "has no 'Stil'. Did you mean 'Still'"),
        ("my_parts", "a class in an installed package or a file of this folder is MODULE:CLASS, such as my_parts:My"),
        ("./my_parts.py:Still", "MODULE:CLASS, such as my_parts:My"),
        ("my_parts:Looking", "`cameras` has 'wrist', which the r1 lacks. Known: head, left, right"),
        ("my_parts:NUMBER", "is no class or function, but int"),
        ("my_parts:Needy", "wants 'weights' to be made; a policy is offered: skills, vocabulary, detector, seed"),
        ("my_parts:Mute", r"a policy has reset\(\), infer\(\), and this has not"),
    ],
)
def test_what_is_no_part_is_refused_before_a_simulator_loads(given: str, said: str) -> None:
    """In one line, with what would be valid."""
    with pytest.raises(UserError, match=said) as error:
        check_backends(replace(CONFIG, policy=given))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("my_parts:Broken", r"making it raised OSError: no weights \(.*my_parts.py:\d+\)"),
        ("my_parts:Nameless", "a policy has name, and this has not"),
    ],
)
def test_what_cannot_be_made_is_told(given: str, said: str) -> None:
    """With the place in its own file, or with what it lacks."""
    with pytest.raises(UserError, match=said):
        make_policy(given, PolicyInputs({}))
