"""`mpvi show`: pictures of things of the catalogue, and of houses and robots with what their files say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.ground.errors import UnknownName, UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mpvi_bt.house.things.catalogue import CatalogueEntry

_FILE = click.Path(dir_okay=False, path_type=Path)
_SMALL, _LARGE = (200, 150), (640, 480)
_JPEG_QUALITY = 85


@click.command()
@click.argument("name", required=False, metavar="NAME")
@click.option("--out", type=_FILE, metavar="FILE", help="File to write, png or jpg.  [default: NAME.png]")
@click.option("--page", type=_FILE, metavar="FILE", help="Write a page of all families instead, as Markdown.")
@click.option("--json", "as_json", is_flag=True, help="For programs: a robot or a house as one JSON object.")
def show(name: str | None, out: Path | None, page: Path | None, as_json: bool) -> None:
    """Draw one thing NAME of the catalogue, or the family NAME with its doors ajar; a task; a house; or a robot.

    Of a task its house is drawn from above, as instance 0 begins. NAME of a house is a name of tasks/houses/, a file or
    generated:SEED: a plan, its rooms and fixtures are printed, and it is drawn from above. NAME of a robot is a name of
    robots/ or a file: its base, joints, cameras and actions are printed, and it is drawn from its side and from above,
    with footprint, views of cameras and reach of arms. With --json these are drawn only if --out is given.

    With --page a picture of every family goes into a folder beside the page, which is named after it.
    """
    from mpvi_bt.ground import paths
    from mpvi_bt.ground.robot.robots import FOLDER
    from mpvi_bt.house.layout.house_names import FOLDER as HOUSES
    from mpvi_bt.house.things.catalogue import load_catalogue
    from mpvi_bt.house.things.families import FAMILIES

    if (name is None) == (page is None):
        raise click.UsageError("Name a thing of the catalogue, a task, a house or a robot, or give --page.")
    if out is not None and out.suffix not in (".png", ".jpg"):
        raise UserError(f"{out}: pictures are written as .png or .jpg.")
    robots = paths.names(FOLDER)
    if name is not None and _shows_house(name):
        _house(name, out, as_json)
        return
    if name is not None and (name in robots or Path(name).suffix in paths.SUFFIXES):
        _robot(name, out, as_json)
        return
    if as_json:
        raise click.UsageError("--json is for robots and houses.")
    catalogue = load_catalogue()
    if page is not None:
        if out is not None:
            raise click.UsageError("--out is for one picture; --page puts its pictures into a folder beside it.")
        from mpvi_bt.house.things.family_page import families, family_page

        for info in families(catalogue):
            if info.example is not None:
                draw(info.example, page.with_suffix("") / f"{info.name}.jpg", _SMALL)
        _write(page, family_page(catalogue, page.stem).encode())
        tell(f"wrote {page}")
        return
    assert name is not None
    entry = catalogue.entries.get(name) or next((entry for entry in catalogue if entry.family == name), None)
    if entry is None and name not in (tasks := paths.names("tasks")):
        known = {*catalogue.entries, *FAMILIES, *tasks, *paths.names(HOUSES), *robots}
        raise UnknownName("catalogue entry, family, task, house or robot", name, known)
    out = out or Path(f"{name}.png")
    if entry is None:
        from mpvi_bt.apps.authoring.house_picture import task_picture

        _keep(task_picture(name), out)
    else:
        draw(entry, out)
    tell(f"wrote {out}")


def draw(entry: CatalogueEntry, path: Path, size: tuple[int, int] = _LARGE) -> None:
    """Write a picture of a thing of the catalogue, its doors ajar; `size`: width and height [px]."""
    from mpvi_bt.house.sim.portrait import portrait

    _keep(portrait(entry, size), path)


def _robot(name: str, out: Path | None, as_json: bool) -> None:
    """Print what there is to say of a robot, and draw it."""
    from mpvi_bt.apps.authoring.robot_picture import robot_picture
    from mpvi_bt.apps.authoring.robot_sheet import robot_sheet
    from mpvi_bt.apps.authoring.sheet_text import sheet_text
    from mpvi_bt.ground import paths
    from mpvi_bt.ground.robot.robot_reading import read_robot
    from mpvi_bt.ground.robot.robots import FOLDER

    file = paths.find_or_file(FOLDER, name)
    robot = read_robot(file)
    sheet = robot_sheet(robot, file)
    tell(json.dumps(sheet, indent=2) if as_json else sheet_text(sheet))
    if out is None and not as_json:
        out = Path(f"{robot.name}.png")
    if out is not None:
        _keep(robot_picture(robot), out)
    if out is not None and not as_json:
        tell(f"\nwrote {out}")


def _house(name: str, out: Path | None, as_json: bool) -> None:
    """Print what there is to say of a house, and draw it."""
    from mpvi_bt.apps.authoring.house_sheet import house_sheet, house_text
    from mpvi_bt.house.layout.house import load_house

    house = load_house(name)
    sheet = house_sheet(house)
    tell(json.dumps(sheet, indent=2) if as_json else house_text(sheet))
    if out is None and not as_json:
        out = Path(f"{house.name.replace(':', '-')}.png")
    if out is not None:
        from mpvi_bt.apps.authoring.house_picture import house_picture

        _keep(house_picture(house), out)
    if out is not None and not as_json:
        tell(f"\nwrote {out}")


def _shows_house(name: str) -> bool:
    """Whether a name or a file is of a house. Raises UserError if there is no such file."""
    from mpvi_bt.ground import paths
    from mpvi_bt.ground.file_kinds import kind_of
    from mpvi_bt.ground.marked_yaml import load_marked
    from mpvi_bt.house.generated.seeded_name import PREFIX
    from mpvi_bt.house.layout.house_names import FOLDER, check_house_name

    if name.startswith(PREFIX):
        check_house_name(name)
        return True
    if Path(name).suffix in paths.SUFFIXES:
        return kind_of(*load_marked(paths.find_or_file(FOLDER, name))).noun == "house"
    return name in paths.names(FOLDER)


def _keep(picture: NDArray[np.uint8], path: Path) -> None:
    import cv2

    how = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if path.suffix == ".jpg" else []
    ok, data = cv2.imencode(path.suffix, picture[..., ::-1], how)
    assert ok
    _write(path, data.tobytes())


def _write(path: Path, data: bytes) -> None:
    from mpvi_bt.ground.writing import unwritable, write_whole

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None
    write_whole(path, data)
