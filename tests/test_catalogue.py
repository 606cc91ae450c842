"""The catalogue and the families that make its shapes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.cli.check import check
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.things.catalogue import CatalogueEntry, load_catalogue
from mpvi_bt.house.things.description import RigidBody
from mpvi_bt.house.things.families import FAMILIES, describe, family

ENTRIES = list(load_catalogue())
JOINTED = [entry for entry in ENTRIES if entry.description.jointed]


def named(entry: CatalogueEntry) -> str:
    return entry.name


def test_every_family_is_used() -> None:
    """A family without an entry would be a family that nobody sees; the meshes are everybody's own."""
    assert {entry.family for entry in ENTRIES} == set(FAMILIES) - {"mesh"}


@pytest.mark.parametrize("entry", ENTRIES, ids=named)
def test_things_stand_on_their_origin(entry: CatalogueEntry) -> None:
    """All but a nail and a mere work surface stand on z = 0; all are found by their synset's words."""
    low, high = entry.description.extent()
    if entry.family not in ("nail", "countertop"):
        assert low[2] == pytest.approx(0, abs=1e-6)
    assert np.all(high > low)
    assert re.sub(r"_+", " ", entry.synset.rsplit(".", 2)[0]) in entry.phrases


@pytest.mark.parametrize("entry", [e for e in ENTRIES if e.mass_kg is not None and e.mass_kg < 10], ids=named)
def test_movable_things_can_be_grasped(entry: CatalogueEntry) -> None:
    """One hand closes on 8.5 cm at most, so a wider thing has a lip, a bar, or a width for two hands under 43 cm."""
    low, high = entry.description.extent()
    root = entry.description.root
    narrowest = (high - low).min()
    assert narrowest <= 0.085 or root.volumes or root.handles or 0.10 < (high - low)[:2].min() < 0.43
    assert np.sort(high - low)[1] < 0.43


@pytest.mark.parametrize("entry", [e for e in ENTRIES if e.description.root.volumes], ids=named)
def test_volumes_lie_inside(entry: CatalogueEntry) -> None:
    """A container volume lies within its body and meets none of the body's own solids but shelves."""
    low, high = entry.description.extent()
    for volume in entry.description.root.volumes:
        box = volume.aabb()
        assert np.all(box[0] >= low - 1e-6)
        assert np.all(box[1] <= high + 1e-6)


@given(
    size=st.tuples(*[st.floats(0.05, 0.5)] * 3),
    wall=st.floats(0.004, 0.01),
)
def test_an_open_box_is_as_large_as_it_says(size: tuple[float, float, float], wall: float) -> None:
    """Outside it has the size given; inside, that less its walls."""
    box = describe("open_box", {"size_m": list(size), "wall_m": wall, "color": "#123456"})
    np.testing.assert_allclose(np.diff(box.extent(), axis=0)[0], size)
    (interior,) = box.root.volumes
    np.testing.assert_allclose(2 * interior.half_m, np.array(size) - [2 * wall, 2 * wall, wall])


@pytest.mark.parametrize("entry", JOINTED, ids=named)
def test_joints_open_outwards(entry: CatalogueEntry) -> None:
    """Opening brings what a hand holds forward or upward, away from the thing, and never backward at first."""
    for body in entry.description.bodies[1:]:
        for handle in body.handles:
            closed, open_ = (_at(body, handle.center, fraction) for fraction in (0.0, 0.1))
            assert max(open_[0] - closed[0], open_[2] - closed[2]) > 0.005


@pytest.mark.parametrize("entry", JOINTED, ids=named)
def test_closed_doors_lie_before_their_carcass(entry: CatalogueEntry) -> None:
    """What turns is at most a hair inside the root's own solids when closed: it lies before them, or on them."""
    corners = np.stack([p.solid.aabb() for p in entry.description.root.parts if p.collides])
    front, top = corners[:, 1, 0].max(), corners[:, 1, 2].max()
    for body in entry.description.bodies[1:]:
        assert body.joint is not None
        if body.joint.kind == "hinge":
            door = min(body.parts, key=lambda p: -float(np.prod(p.solid.half_m)))
            low = door.solid.moved(body.frame()).aabb()[0]
            assert low[0] > front - 0.06 or low[2] > top - 0.002
        assert 0 < body.joint.limit <= 2.0


def _at(body: RigidBody, point: np.ndarray, fraction: float) -> np.ndarray:
    assert body.joint is not None
    T = body.frame(fraction * body.joint.limit)
    return T[:3, :3] @ point + T[:3, 3]


def test_unknown_family_names_the_nearest() -> None:
    """A family that is not known is refused with the nearest that is."""
    with pytest.raises(UnknownName, match="Did you mean 'bottle'"):
        family("botle")


@given(key=st.text("abcdefghijklmnopqrstuvwxyz_", min_size=1).filter(lambda k: k not in ("diameter_m", "color")))
def test_unknown_parameters_never_pass(key: str) -> None:
    """No family takes a parameter that its function does not."""
    with pytest.raises(ValidationError):
        describe("ball", {"diameter_m": 0.1, "color": "#aabbcc", key: 1})


def test_problems_of_a_catalogue_come_at_once(tmp_path: Path) -> None:
    """A wrong family, parameter, synset and color are told together, each on its line."""
    path = tmp_path / "objects.yaml"
    path.write_text(
        "entries:\n"
        "  a: {synset: a.n.01, family: bal, shape: {}}\n"
        "  b: {synset: b.n.01, family: ball, shape: {diamter_m: 0.1, color: red}}\n"
    )
    with pytest.raises(FileProblems) as caught:
        load_catalogue(path)
    found = {(p.code, p.line) for p in caught.value.problems}
    assert found == {("unknown-family", 2), ("unknown-key", 3), ("missing-key", 3), ("invalid-value", 3)}
    assert "Did you mean 'ball'?" in str(caught.value)


def test_a_changed_shape_is_another_entry() -> None:
    """Reshaping leaves the catalogue's own entry as it is."""
    catalogue = load_catalogue()
    tall = catalogue["can_of_soda"].reshaped({"height_m": 0.2})
    assert tall.description.extent()[1, 2] == pytest.approx(0.2)
    assert catalogue["can_of_soda"].description.extent()[1, 2] == pytest.approx(0.122)


BALL = "{synset: %s, family: ball, shape: {diameter_m: 0.1, color: '#123456'}%s}"


def catalogue_file(root: Path, name: str, **entries: str) -> Path:
    """A file of the catalogue of a root: entries by name, each as YAML."""
    path = root / "tasks" / "catalogues" / f"{name}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(["entries:\n", *(f"  {name}: {entry}\n" for name, entry in entries.items())]))
    return path


def said(path: Path) -> list[str]:
    """What `mpvi check` says of a file, without its name."""
    return [str(problem).removeprefix(f"{path}:") for problem in problems_in(str(path))]


def exit_code(path: Path) -> int:
    """Of `mpvi check`."""
    code: int = CliRunner().invoke(check, [str(path)], standalone_mode=False).return_value
    return code


def test_numbers_of_heat_that_make_no_sense_are_told(tmp_path: Path) -> None:
    """A melting point of 1e9, and a source that wants a switch, a door or room inside that its thing does not have."""
    path = catalogue_file(tmp_path, "mine", a=BALL % ("ball.n.01", ", heat: {freezes_c: 1e9}"))
    assert said(path) == ["2:102: should be less than or equal to 20, not 1000000000.0 [out-of-range]"]
    source = ", source: {at_c: 100, placing: near, switched: true}"
    path = catalogue_file(tmp_path, "mine", a=BALL % ("ball.n.01", source))
    assert said(path) == ["2:129: 'ball' has not a switch that its source asks for [impossible-source]"]
    path = catalogue_file(tmp_path, "mine", a=BALL % ("ball.n.01", ", source: {at_c: -18, shut: true}"))
    assert [line.split(": ", 1)[1] for line in said(path)] == [
        "'ball' has not room inside that its source asks for [impossible-source]",
        "'ball' has not a door that its source asks for [impossible-source]",
    ]


def test_names_that_behavior_does_not_have_are_told(tmp_path: Path) -> None:
    """A misspelt synset is a warning, as a thing of one's own may have its own; a misspelt ability is an error."""
    path = catalogue_file(
        tmp_path, "mine", a=BALL % ("basebal.n.02", ""), b=BALL % ("ball.n.01", ", abilities: [filable]")
    )
    assert said(path) == ["3:96: unknown ability 'filable'. Did you mean 'fillable'? [unknown-ability]"]
    path = catalogue_file(tmp_path, "mine", a=BALL % ("basebal.n.02", ""), b=BALL % ("zzzzz.n.01", ""))
    assert said(path) == [
        "2:15: warning: unknown synset 'basebal.n.02'. Did you mean 'baseball.n.02'? [unknown-synset]",
        "3:15: warning: unknown synset 'zzzzz.n.01'. It is none of BEHAVIOR's. [unknown-synset]",
    ]
    assert [entry.synset for entry in load_catalogue(path)] == ["basebal.n.02", "zzzzz.n.01"]


def test_catalogues_of_all_roots_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every file under tasks/catalogues/ of every root is read; of namesakes the first counts, which check notes."""
    one, two = tmp_path / "one", tmp_path / "two"
    first = catalogue_file(one, "a", marble=BALL % ("pool_ball.n.01", ""), plate=BALL % ("baseball.n.02", ""))
    second = catalogue_file(one, "b", marble=BALL % ("baseball.n.02", ""))
    third = catalogue_file(two, "objects", marble=BALL % ("tennis_ball.n.01", ""), globe=BALL % ("globe.n.03", ""))
    monkeypatch.setenv("MPVI_PATH", f"{one}:{two}")
    catalogue = load_catalogue()
    assert {name: catalogue[name].synset for name in ("marble", "plate", "globe", "can_of_soda")} == {
        "marble": "pool_ball.n.01", "plate": "baseball.n.02", "globe": "globe.n.03",
        "can_of_soda": "can__of__soda.n.01",
    }  # fmt: skip
    shipped = paths.shipped() / "tasks" / "catalogues" / "objects.yaml"
    line = shipped.read_text().splitlines().index("  plate:") + 1
    assert said(first) == [
        f"2:3: note: 'marble' takes the place of that in {second}:2 [shadows]",
        f"2:3: note: 'marble' takes the place of that in {third}:2 [shadows]",
        f"3:3: note: 'plate' takes the place of that in {shipped}:{line} [shadows]",
    ]
    assert said(second)[0] == f"2:3: warning: 'marble' is not used: that in {first}:2 comes first [shadowed]"
    assert said(third)[0] == f"2:3: note: 'marble' is not used: that in {first}:2 comes first [shadowed]"
    assert exit_code(first) == 0
    assert exit_code(second) == 1
    catalogue_file(two, "objects", cube=BALL % ("cube.n.05", ""))
    assert "cube" in load_catalogue().entries  # what has changed is read again


def test_a_task_may_be_about_things_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry of a second file is found by tasks."""
    catalogue_file(tmp_path, "mine", my_can=BALL % ("can__of__soda.n.01", ""))
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    path = tmp_path / "tasks" / "mine.yaml"
    path.write_text(paths.find("tasks", "picking_up_trash").read_text().replace(": can_of_soda", ": my_can"))
    assert load_task("mine").bindings["can__of__soda.n.01"] == "my_can"
