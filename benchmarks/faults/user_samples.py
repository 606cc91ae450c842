"""Good files of what users bring: a robot, a bridge to it, a drawn house, a checkpoint of LeRobot's, eyes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.faults.mutations import BYTES, TEXT, aliases, of_arrays, of_json, of_yaml
from benchmarks.faults.samples import Kind, checked, quiet
from mpvi_bt.ground import paths


def user_kinds(folder: Path) -> Iterable[Kind]:
    """Every kind of file that is a user's own; those that no repository has are made in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    yield from _robots()
    yield from _houses(folder)
    yield from _checkpoints(folder)
    yield from _eyes(folder)


def _robots() -> Iterable[Kind]:
    from mpvi_bt.ground.robot.robot_reading import read_robot
    from mpvi_bt.ground.robot.robots import robot_named
    from mpvi_bt.ground.robot.urdf_tree import read_urdf_tree
    from mpvi_bt.runs.ros2.bridge_file import load_bridge

    yaml = [*TEXT, of_yaml, of_yaml, of_yaml, aliases]
    files = [path for path in paths.files("robots") if path.suffix == ".yaml"]
    urdfs = {path.stem + ".urdf": path.with_suffix(".urdf").read_bytes() for path in files}

    def robot(path: Path) -> str | None:
        for name, data in urdfs.items():  # that it names
            (path.parent / name).write_bytes(data)
        return checked(read_robot)(path)

    robots = {f"robots/{path.name}": path.read_bytes() for path in files}
    yield Kind("robot", robots, robot, yaml, "yaml")
    small = min(urdfs, key=lambda name: len(urdfs[name]))
    yield Kind("URDF", {f"urdf/{small}": urdfs[small]}, lambda path: quiet(read_urdf_tree(path)), TEXT)
    bridges = {f"bridges/{path.name}": path.read_bytes() for path in paths.files("bridges")}
    fetch = robot_named("fetch")
    yield Kind("bridge", bridges, checked(lambda path: load_bridge(str(path), fetch)), yaml, "yaml")


def _houses(folder: Path) -> Iterable[Kind]:
    from mpvi_bt.ground.marked_yaml import parse_marked
    from mpvi_bt.house.generated.generator import generated_house
    from mpvi_bt.house.imported.imported_house import imported_house
    from mpvi_bt.house.layout.house import check_house, load_house
    from tests.procthor_houses import house, written

    drawn = {"drawn/flat.yaml": generated_house(3, kind="flat").encode()}
    yield Kind("drawn house", drawn, checked(load_house), [*TEXT, of_yaml, of_yaml, of_yaml, aliases], "yaml")

    def rebuilt(path: Path) -> None:
        text, _ = imported_house(path)
        check_house(*parse_marked(text, f"{path.name}.yaml"))  # what is rebuilt is a house, or it was refused

    theirs = {"theirs.json": written(folder, house()).read_bytes()}
    yield Kind("house of ProcTHOR's", theirs, lambda path: quiet(rebuilt(path)), [*TEXT, of_json, of_json, of_json])


def _checkpoints(folder: Path) -> Iterable[Kind]:
    from mpvi_bt.executive.remote.dialect_settings import DialectSettings
    from mpvi_bt.executive.remote.lerobot_checkpoint import fitting_checkpoint
    from tests.lerobot_files import checkpoint, dataset

    trained_on = dataset(folder / "dataset")
    whole = checkpoint(folder / "act", trained_on)

    def checkpoint_with(path: Path) -> None:
        for good in whole.iterdir():
            if good.name != path.name:
                (path.parent / good.name).write_bytes(good.read_bytes())
        fitting_checkpoint(path.parent, DialectSettings(), None)

    files = {f"act/{name}": (whole / name).read_bytes() for name in ("config.json", "train_config.json")}
    json_ = [*TEXT, of_json, of_json, of_json]
    yield Kind("LeRobot checkpoint", files, lambda path: quiet(checkpoint_with(path)), json_)

    def trained_with(path: Path) -> None:
        checkpoint(path.parents[2] / "of_it", path.parents[1])
        fitting_checkpoint(path.parents[2] / "of_it", DialectSettings(), None)

    info = {"set/meta/info.json": (trained_on / "meta/info.json").read_bytes()}
    yield Kind("LeRobot dataset", info, lambda path: quiet(trained_with(path)), json_)


def _eyes(folder: Path) -> Iterable[Kind]:
    from mpvi_bt.finding.eyes.eyes_network import EyesNetwork
    from mpvi_bt.finding.eyes.picture_file import LabeledPicture, PictureFile, write_pictures
    from mpvi_bt.finding.eyes.segmenter import SHIPPED

    arrays = [*BYTES, of_arrays, of_arrays]
    weights = {"eyes.npz": SHIPPED.read_bytes()}
    yield Kind("weights of eyes", weights, lambda path: quiet(EyesNetwork.load(path)), arrays, "arrays")

    picture = LabeledPicture(
        rgb=np.full((24, 32, 3), 90, np.uint8), depth=np.full((24, 32), 1.5, np.float32),
        labels=np.eye(24, 32, dtype=np.uint8), kinds=("cup.n.01",), drawn=("kind",), K=np.eye(3),
        T_world_camera=np.eye(4), camera="head",
    )  # fmt: skip
    write_pictures(folder / "pictures.npz", [picture, picture])

    def look(path: Path) -> None:
        for _ in PictureFile(path):
            pass

    pictures = {"pictures.npz": (folder / "pictures.npz").read_bytes()}
    yield Kind("pictures of eyes", pictures, lambda path: quiet(look(path)), arrays, "arrays")
