"""Learned eyes: what goes into the networks, segments from their answers, and their training."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.finding.eyes.crops import CROP_CHANNELS, CROP_PX, NUMBERS, Crops, crops_of
from mpvi_bt.finding.eyes.eyes_layers import CELL_PX, OFFSET_PX, crop_layers, dense_layers, layers
from mpvi_bt.finding.eyes.eyes_network import EyesNetwork
from mpvi_bt.finding.eyes.first_look_training import FirstLook
from mpvi_bt.finding.eyes.grouping import movable_segments, sharpened, still_segments
from mpvi_bt.finding.eyes.inputs import CHANNELS, inputs_of
from mpvi_bt.finding.eyes.look_training import EyesTraining, Look, train_look
from mpvi_bt.finding.eyes.picture_file import LabeledPicture, PictureFile, pictures_in, write_pictures
from mpvi_bt.finding.eyes.score_calibration import calibrated
from mpvi_bt.finding.eyes.second_look_training import SecondLook
from mpvi_bt.finding.eyes.segment_overlaps import right_ones
from mpvi_bt.finding.eyes.segmenter import SHIPPED, LearnedSegmenter
from mpvi_bt.finding.eyes.tiles import TILE, Tiles
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.protocol import CameraImage
from tests.conftest import Shell

K = np.array([[200.0, 0, 160], [0, 200, 120], [0, 0, 1]])
DOWN = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]])  # level, 1.2 m up, looking along x


def picture(seed: int = 0) -> LabeledPicture:
    """A floor, a wall 3 m away, and two red things and a chair before it."""
    rng = np.random.default_rng(seed)
    rows = (np.arange(240) + 0.5 - 120) / 200
    ground = np.where(rows > 0, 1.2 / np.maximum(rows, 1e-3), np.inf)
    depth = np.repeat(np.minimum(ground, 3.0)[:, None], 320, 1)
    labels = np.repeat(np.where(ground < 3.0, 1, 0)[:, None], 320, 1).astype(np.uint8)
    rgb = np.full((240, 320, 3), 150, np.uint8)
    for number, (left, kind_color) in enumerate(((60, (200, 20, 20)), (100, (200, 20, 20)), (220, (90, 60, 20))), 2):
        box = slice(100 + int(rng.integers(10)), 170), slice(left, left + 36)
        depth[box], labels[box], rgb[box] = 1.5 + 0.2 * number, number, kind_color
    kinds, drawn = ("floor", "can.n.01", "can.n.01", "chair"), ("fixture", "catalogue", "catalogue", "fixture")
    return LabeledPicture(rgb, depth.astype(np.float32), labels, kinds, drawn, K, DOWN, "head")


def image(seed: int = 0) -> CameraImage:
    """The same without labels."""
    seen = picture(seed)
    return CameraImage("head", seen.rgb, seen.depth, None, {}, seen.K, seen.T_world_camera)


def network(seed: int = 0) -> EyesNetwork:
    """One with random weights."""
    rng = np.random.default_rng(seed)
    still, movable = ("chair", "floor", "robot"), ("can.n.01", "cup.n.01")
    weights = {}
    for layer in [*layers(len(still)), *crop_layers(), *dense_layers(len(movable))]:
        into = layer.size**2 * layer.into
        weights[f"{layer.name}.weight"] = rng.normal(0, np.sqrt(1.5 / into), (into, layer.out)).astype(np.float32)
        weights[f"{layer.name}.bias"] = np.zeros(layer.out, np.float32)
    return EyesNetwork(still, movable, weights, (0.0, 1.0, 0.5, 0.0, 0.1, 1.0, 0.5, 0.2), {"seed": seed})


def test_pictures_are_read_as_they_were_written(tmp_path: Path) -> None:
    """A file of pictures gives them back; depth is rounded to a quarter of a millimeter."""
    written = [picture(0), replace(picture(1), camera="left")]
    write_pictures(tmp_path / "some.npz", written)
    read = list(PictureFile(tmp_path / "some.npz"))
    for a, b in zip(written, read, strict=True):
        assert (a.rgb == b.rgb).all()
        assert (a.labels == b.labels).all()
        assert np.abs(a.depth - b.depth).max() < 0.0002
        assert (a.kinds, a.drawn, a.camera) == (b.kinds, b.drawn, b.camera)


def test_what_is_no_file_of_pictures_is_said(tmp_path: Path) -> None:
    """A broken file is named in one line."""
    (tmp_path / "bad.npz").write_bytes(b"PK not really")
    with pytest.raises(UserError, match=r"bad\.npz: is no file of pictures"):
        PictureFile(tmp_path / "bad.npz")
    with pytest.raises(UserError, match="there are no pictures"):
        Tiles(tmp_path / "none", ("chair",))


@pytest.mark.parametrize("array", ["count", "kinds", "drawn", "K", "T_world_camera", "camera", "picture_0"])
@pytest.mark.parametrize("change", ["shorter", "words", "gone"])
def test_arrays_that_do_not_fit_one_another_are_refused(tmp_path: Path, array: str, change: str) -> None:
    """No picture gets the things or the place of another."""
    write_pictures(tmp_path / "some.npz", [picture(0), picture(1)])
    with np.load(tmp_path / "some.npz") as kept:
        arrays = dict(kept)
    if change == "gone":
        del arrays[array]
    elif change == "shorter" or arrays[array].dtype.kind == "U":
        arrays[array] = arrays[array][:-1]
    else:
        arrays[array] = np.full(arrays[array].shape, "x")
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(UserError, match=r"bad\.npz: (is no file of pictures|picture 0 is damaged)"):
        list(PictureFile(tmp_path / "bad.npz"))


def test_inputs_tell_height_and_level_surfaces() -> None:
    """The floor is at height 0 and level, the wall upright, whichever way the camera is turned about the vertical."""
    seen = picture()
    inputs = inputs_of(seen.rgb, seen.depth, K, DOWN)
    floor, wall = inputs[225, 160], inputs[20, 300]
    assert floor[4] == pytest.approx(-1, abs=1e-5)
    assert floor[9] == pytest.approx(1, abs=0.01)
    assert wall[9] == pytest.approx(0, abs=0.01)
    turned = DOWN.copy()
    turned[:2] = [[0, 1], [-1, 0]] @ DOWN[:2]
    assert np.allclose(inputs, inputs_of(seen.rgb, seen.depth, K, turned))


def test_a_mirrored_picture_has_mirrored_inputs() -> None:
    """What trains on both must see both alike."""
    seen = picture()
    flipped = inputs_of(seen.rgb[:, ::-1], seen.depth[:, ::-1], K, DOWN)
    assert np.allclose(flipped[:, ::-1], inputs_of(seen.rgb, seen.depth, K, DOWN), atol=1e-4)


def test_touching_things_are_parted_by_their_centers() -> None:
    """Two things that touch, at one depth, are two segments where two centers are seen, and one where one is."""
    movable = np.zeros((48, 64), bool)
    movable[16:32, 8:48] = True
    depth = np.ones((48, 64), np.float32)
    near, way = np.full((12, 16), -5.0, np.float32), np.zeros((12, 16, 2), np.float32)
    near[5, 4] = near[5, 9] = 3.0
    xs = np.arange(16) * 4 + 1.5
    way[..., 0] = (np.where(xs < 28, 17.5, 37.5) - xs) / OFFSET_PX
    things, count = movable_segments(movable, depth, near, way)
    assert count == 2
    assert things[20, 10] != things[20, 40]
    assert ((things > 0) == movable).all()
    near[5, 9] = -5.0
    assert movable_segments(movable, depth, near, way)[1] == 1


def test_a_step_of_depth_parts_things() -> None:
    """Neighbors of one kind at different depths are two segments; what is whole is one."""
    kinds = np.ones((20, 40), np.int32)
    depth = np.ones((20, 40), np.float32)
    depth[:, 20:] = 2.0
    labels, found = still_segments(kinds, depth, np.zeros(0, np.int32))
    assert found.tolist() == [1, 1]
    assert labels[0, 0] != labels[0, 30]
    labels, found = still_segments(kinds, depth, np.array([1], np.int32))
    assert found.tolist() == [1]
    assert (labels == 1).all()


def test_pixels_take_the_cell_of_their_depth() -> None:
    """At an edge of depth a pixel belongs to the neighboring cell that is as far away as it."""
    depth = np.ones((8, 16), np.float32)
    depth[:, 6:] = 2.0
    cells = np.array([[1, 1, 2, 2], [1, 1, 2, 2]], np.int32)
    cells[:, 1] = 1  # its right half is far: it is of the next cell's thing
    out = sharpened(cells, np.ones((8, 16), bool), depth)
    assert (out[:, :6] == 1).all()
    assert (out[:, 8:] == 2).all()


def test_a_crop_is_about_its_thing() -> None:
    """The mask fills the middle of its crop, and the numbers say how large the thing is in meters."""
    seen = picture()
    crops = crops_of(inputs_of(seen.rgb, seen.depth, K, DOWN), seen.depth, (seen.labels == 2).astype(np.int32), 1, K,
                     DOWN)  # fmt: skip
    assert crops.planes.shape == (1, CROP_PX, CROP_PX, CROP_CHANNELS)
    assert crops.numbers.shape == (1, NUMBERS)
    assert crops.planes[0, CROP_PX // 2, CROP_PX // 2, -1] == 1
    assert crops.planes[0, 0, :, -1].max() == 0
    assert 0.1 * np.exp(crops.numbers[0, 1]) == pytest.approx(36 * 1.9 / 200, rel=0.01)


def test_a_picture_is_seen_alike_each_time() -> None:
    """Segments of a picture hang on nothing but the picture, and are numbered from 1."""
    first, again = (LearnedSegmenter(network()).segment(image()) for _ in range(2))
    assert (first.labels == again.labels).all()
    assert first.kinds == again.kinds
    assert (first.scores == again.scores).all()
    assert first.labels.shape == (240, 320)
    assert first.labels.dtype == np.int32
    assert set(np.unique(first.labels).tolist()) - {0} == set(range(1, len(first.kinds) + 1))
    assert len(first.scores) == len(first.kinds)
    assert ((0 <= first.scores) & (first.scores <= 1)).all()
    assert set(first.kinds) <= set(LearnedSegmenter(network()).kinds)


def test_labels_are_not_looked_at() -> None:
    """A picture with labels is seen as the same one without."""
    plain, told = image(), replace(image(), labels=picture().labels.astype(np.int32), names={1: "floor_hall"})
    eyes = LearnedSegmenter(network())
    assert (eyes.segment(plain).labels == eyes.segment(told).labels).all()


def test_what_is_expected_is_seen_rather() -> None:
    """No movable pixel is taken for it less often, scores of it only rise, and no network is asked again."""
    asked = network()
    plain = LearnedSegmenter(asked).segment(image())
    asked.weights.clear()  # type: ignore[attr-defined]
    for kind in ("can.n.01", "cup.n.01"):
        told = plain.expecting({kind})
        before, after = (
            np.where([k == kind for k in seen.kinds], seen.scores, 0.0).max(initial=0.0) for seen in (plain, told)
        )
        assert 0 < after >= before
        shows = [np.isin(seen.labels, [n for n, k in enumerate(seen.kinds, 1) if k == kind]) for seen in (plain, told)]
        assert (shows[0] <= shows[1]).all()
    assert plain.expecting(set()) is plain


def test_what_is_known_to_be_one_thing_is_one_segment() -> None:
    """Whatever the picture looks like there. Where nothing is known, the picture is seen as without."""
    thing = np.zeros((240, 320), np.int32)
    thing[40:150, 50:130] = 1
    plain = LearnedSegmenter(network()).segment(image())
    told = plain.expecting({"can.n.01", "cup.n.01"}, thing)
    (number,) = np.unique(told.labels[thing > 0])
    assert told.kinds[number - 1] in ("can.n.01", "cup.n.01")
    assert (told.labels == number).sum() == thing.sum()
    assert 0.5 < told.scores[number - 1] <= 1
    nothing = plain.expecting({"can.n.01"}, np.zeros_like(thing))
    assert (nothing.labels == plain.expecting({"can.n.01"}).labels).all()


def test_odd_sizes_and_no_depth_are_seen() -> None:
    """A picture of any size has segments of its size, even one without any depth."""
    eyes = LearnedSegmenter(network())
    for h, w in ((224, 224), (61, 47)):
        dark = CameraImage("left", np.zeros((h, w, 3), np.uint8), np.zeros((h, w), np.float32), None, {}, K, DOWN)
        assert eyes.segment(dark).labels.shape == (h, w)


def test_weights_are_read_as_they_were_written(tmp_path: Path) -> None:
    """A file of weights gives the network back, in half precision; a broken one is named."""
    network().save(tmp_path / "eyes.npz")
    kept = EyesNetwork.load(tmp_path / "eyes.npz")
    assert (kept.still, kept.movable, kept.calibration) == (network().still, network().movable, network().calibration)
    again = EyesNetwork.load(tmp_path / "eyes.npz")
    assert all((kept.weights[name] == again.weights[name]).all() for name in kept.weights)
    (tmp_path / "eyes.npz").write_bytes((tmp_path / "eyes.npz").read_bytes()[:-500])
    with pytest.raises(UserError, match=r"eyes\.npz: no whole file of weights"):
        EyesNetwork.load(tmp_path / "eyes.npz")
    with pytest.raises(UserError, match="no such file"):
        EyesNetwork.load(tmp_path / "none.npz")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("pictures")
    write_pictures(out / "train-00000.npz", [picture(seed) for seed in range(6)])
    return out


def test_tiles_tell_what_is_due(folder: Path) -> None:
    """Movable cells have the last number, others that of their kind; ways lead to centers of things."""
    tile = Tiles(folder, ("chair", "floor")).batch(6, np.random.default_rng(0))
    assert tile.inputs.shape == (6, *TILE, CHANNELS)
    assert set(np.unique(tile.kinds)) <= {0, 1, 2, 3}
    assert ((tile.kinds == 3) >= (tile.movable > 0)).all()
    assert tile.near.max() == 1.0
    assert np.isfinite(tile.way).all()


def test_torch_and_numpy_see_alike() -> None:
    """Weights that torch trains answer alike in numpy, normalization folded in."""
    torch = pytest.importorskip("torch")
    job = EyesTraining(Path())
    torch.manual_seed(0)
    first, second = FirstLook(("a", "b", "c"), job), SecondLook(("d", "e"), job)
    for trained in (first, second):
        for name, value in trained.average.items():
            if "running_mean" in name or "running_var" in name:
                value.uniform_(0.5, 1.5)
        trained.net.load_state_dict(trained.average)
        trained.net.eval()
    weights: Mapping[str, np.ndarray] = {**first.weights(), **second.weights()}
    eyes = EyesNetwork(
        ("a", "b", "c"), ("d", "e"), {name: w.astype(np.float32) for name, w in weights.items()}, (0.0,) * 8, {}
    )
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(64, 96, CHANNELS)).astype(np.float32)
    answers = eyes.look(inputs)
    crops = Crops(rng.normal(size=(3, CROP_PX, CROP_PX, CROP_CHANNELS)).astype(np.float32),
                  rng.normal(size=(3, NUMBERS)).astype(np.float32))  # fmt: skip
    with torch.no_grad():
        kinds, covers, center = first.forward(torch.from_numpy(inputs)[None].permute(0, 3, 1, 2))
        told = second.forward(torch.from_numpy(crops.planes).permute(0, 3, 1, 2), torch.from_numpy(crops.numbers))
    assert np.allclose(kinds[0].permute(1, 2, 0).numpy(), answers.kinds, atol=1e-3)
    shuffled = torch.nn.functional.pixel_shuffle(covers, CELL_PX)[0]
    assert np.allclose(shuffled.numpy(), answers.covers, atol=1e-3)
    assert np.allclose(center[0, 0].numpy(), answers.near, atol=1e-3)
    assert np.allclose(center[0, 1:].permute(1, 2, 0).numpy(), answers.way, atol=1e-3)
    assert np.allclose(told.softmax(1).numpy(), eyes.tell(crops), atol=1e-4)


@pytest.mark.parametrize("look", [FirstLook, SecondLook])
def test_a_training_that_was_stopped_goes_on(look: Callable[..., Look], folder: Path, tmp_path: Path) -> None:
    """Training goes on from what was kept, alike each time, and refuses what is of another training."""
    pytest.importorskip("torch")
    told: list[dict[str, object]] = []
    job = EyesTraining(folder, seed=1, steps=2)
    first = train_look(lambda kinds: look(kinds, job), job, tmp_path / "a.pt", told.append).weights()
    again = train_look(lambda kinds: look(kinds, job), job, tmp_path / "b.pt", told.append).weights()
    kept = train_look(lambda kinds: look(kinds, job), job, tmp_path / "a.pt", told.append).weights()
    assert all((first[name] == again[name]).all() and (first[name] == kept[name]).all() for name in first)
    assert [row["step"] for row in told] == [2, 2]
    other = EyesTraining(folder, seed=2, steps=2)
    with pytest.raises(UserError, match="is of another training"):
        train_look(lambda kinds: look(kinds, other), other, tmp_path / "a.pt", told.append)


def test_scores_are_calibrated(folder: Path) -> None:
    """Calibration changes scores only, and is the same each time."""
    plain = network()
    pictures = pictures_in(folder)
    told, again = (calibrated(plain, pictures) for _ in range(2))
    assert told.calibration == again.calibration != plain.calibration
    a, b = (LearnedSegmenter(eyes).segment(image()) for eyes in (plain, told))
    assert (a.labels == b.labels).all()
    assert a.kinds == b.kinds


def test_a_segment_is_right_where_it_shares_half_with_its_thing() -> None:
    """A segment on its thing is right, one of another kind or of less than half is not."""
    seen = picture()
    labels = np.where(seen.labels == 2, 1, 0).astype(np.int32)
    labels[seen.labels == 3] = 2
    labels[:120][labels[:120] == 2] = 0
    assert right_ones(labels, ("can.n.01", "can.n.01"), seen).tolist() == [True, True]
    assert right_ones(labels, ("cup.n.01", "can.n.01"), seen).tolist() == [False, True]
    labels[:150][labels[:150] == 2] = 0
    assert right_ones(labels, ("can.n.01", "can.n.01"), seen).tolist() == [True, False]


def test_eyes_are_trained_by_a_command(mpvi: Shell, folder: Path, tmp_path: Path) -> None:
    """`mpvi train eyes` writes weights that see, and says what is wrong with a folder."""
    pytest.importorskip("torch")
    out = tmp_path / "mine.npz"
    steps = ("--first-steps", "1", "--second-steps", "1")
    done = mpvi("train", "eyes", str(folder), "--check", str(folder), "--out", str(out), *steps, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "kinds of furniture" in done.stdout
    assert LearnedSegmenter.load(out).segment(image()).labels.shape == (240, 320)
    (tmp_path / "empty").mkdir()
    failed = mpvi("train", "eyes", str(tmp_path / "empty"), "--check", str(folder), "--out", str(out))
    assert failed.returncode != 0
    assert "there are no pictures" in failed.stderr


def test_the_weights_that_ship_see() -> None:
    """Weights are in the package, of less than 8 MB, know the catalogue's things, and see a floor before a wall."""
    assert SHIPPED.stat().st_size < 8e6
    eyes = LearnedSegmenter.load()
    assert {"floor", "robot", "chair", "switch", "can__of__soda.n.01"} <= set(eyes.kinds)
    seen = eyes.segment(image())
    floor = seen.kinds.index("floor") + 1
    assert (seen.labels[200:, 160] == floor).mean() > 0.9
    assert seen.scores[floor - 1] > 0.5
