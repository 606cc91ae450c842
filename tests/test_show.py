"""Pictures of the catalogue: `mpvi show`, and the page of all families."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.families import FAMILIES
from mpvi_bt.house.things.family_page import families, family_page
from tests.conftest import Shell

DOCS = Path(__file__).parent.parent / "docs"


def test_the_page_of_families_is_as_the_code_has_them() -> None:
    """Each with its parameters, and a picture that is there; `mpvi show --page docs/families.md` writes it."""
    assert (DOCS / "families.md").read_text(encoding="utf-8") == family_page(load_catalogue(), "families")
    pictured = {info.name for info in families(load_catalogue()) if info.example is not None}
    assert {path.stem for path in (DOCS / "families").glob("*.jpg")} == pictured
    assert {info.name for info in families(load_catalogue())} == set(FAMILIES)


def test_lists_have_every_thing_and_every_family(mpvi: Shell) -> None:
    """By name."""
    assert set(json.loads(mpvi("list", "objects", "--json").stdout)) == set(load_catalogue().entries)
    assert set(json.loads(mpvi("list", "families", "--json").stdout)) == set(FAMILIES)


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["trash_cam"], "Did you mean 'trash_can'?"),
        (["picking_up_trush"], "Did you mean 'picking_up_trash'?"),
        (["trash_can", "--out", "x.gif"], "x.gif: pictures are written as .png or .jpg."),
        (["fetsh"], "Did you mean 'fetch'?"),
        (["cup", "--json"], "--json is for robots and houses."),
        (["fetch", "--out", "x.gif"], "x.gif: pictures are written as .png or .jpg."),
        (["famly_house"], "Did you mean 'family_house'?"),
        (["generated:x"], "generated:7"),
        (["no_robot.yaml"], "no_robot.yaml: there is no such file."),
        ([], "Name a thing of the catalogue, a task, a house or a robot, or give --page."),
        (["cup", "--page", "x.md"], "Name a thing of the catalogue, a task, a house or a robot, or give --page."),
    ],
)
def test_what_cannot_be_shown_is_told(args: list[str], said: str, mpvi: Shell) -> None:
    """In one line, before anything is drawn."""
    done = mpvi("show", *args)
    assert (done.returncode, done.stderr.count("\n"), said in done.stderr) == (2, 1, True)


@pytest.mark.render
def test_a_thing_of_ones_own_is_drawn(tmp_path: Path, mpvi: Shell) -> None:
    """In its color, in the middle."""
    folder = tmp_path / "tasks" / "catalogues"
    folder.mkdir(parents=True)
    (folder / "own.yaml").write_text(
        "entries:\n  beacon: {synset: ball.n.01, family: ball, mass_kg: 0.1, "
        "shape: {diameter_m: 0.1, color: '#e01010'}}\n"
    )
    done = mpvi("show", "beacon", MPVI_PATH=str(tmp_path))
    assert (done.returncode, done.stdout) == (0, "wrote beacon.png\n")
    import cv2

    picture = cv2.imread(str(tmp_path / "beacon.png"))
    assert picture is not None
    assert picture.shape == (480, 640, 3)
    blue, green, red = picture[240, 320].astype(int)
    assert red > 2 * max(blue, green)


@pytest.mark.render
def test_the_house_of_a_task_is_drawn(mpvi: Shell, tmp_path: Path) -> None:
    """Wide, and with the garden's grass in it, which is the only green of its kind."""
    done = mpvi("show", "picking_up_trash", "--out", "house.png")
    assert (done.returncode, done.stdout) == (0, "wrote house.png\n")
    import cv2

    picture = cv2.imread(str(tmp_path / "house.png"))
    assert picture is not None
    assert picture.shape == (640, 1400, 3)
    blue, green, red = (picture[..., k].astype(int) for k in range(3))
    assert 0.02 < ((green > red + 30) & (green > blue + 60)).mean() < 0.4
