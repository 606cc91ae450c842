"""A camera of a robot's file: its value, and what does not fit of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.robot_file import CameraPart
from mpvi_bt.ground.robot.robot_findings import RobotFindings


def check_cameras(findings: RobotFindings, cameras: Mapping[str, CameraPart], base_link: str) -> None:
    """Tell what does not fit: one of them is the head, and all hang below the base frame."""
    for name, part in cameras.items():
        findings.check_frame(("cameras", name), part, base_link)
    if "head" not in cameras:
        names = ", ".join(cameras) or "none"
        message = f"the camera to search with is named 'head'; there are: {names}"
        findings.tell(("cameras",), "missing-key", message, key=True)
    elif not cameras["head"].depth:
        message = "the head camera has to measure depth (`depth: true`): maps and places come from it"
        findings.tell(("cameras", "head"), "missing-key", message, key=True)
    for name, part in cameras.items():
        for message in _misfits(part):
            findings.tell(("cameras", name), "out-of-range", message, key=True)


def camera_of(part: CameraPart) -> Camera:
    """The camera as a value; what does not fit has been told."""
    width, height = part.size
    if part.fov_rad is not None:
        return Camera(width, height, part.fov_rad, part.near_m, part.far_m, part.link, None, part.depth)
    assert part.fy is not None
    fx = part.fx if part.fx is not None else part.fy
    cx = part.cx if part.cx is not None else width / 2
    cy = part.cy if part.cy is not None else height / 2
    fov_rad = 2 * math.atan(height / 2 / part.fy)
    return Camera(width, height, fov_rad, part.near_m, part.far_m, part.link, (fx, part.fy, cx, cy), part.depth)


def _misfits(part: CameraPart) -> Iterator[str]:
    """What does not fit of a camera's intrinsics."""
    width, height = part.size
    given = {key: getattr(part, key) for key in ("fx", "fy", "cx", "cy") if getattr(part, key) is not None}
    if part.fov_rad is not None and given:
        yield f"fov_rad and {', '.join(given)} say the same: give one of them"
    elif part.fov_rad is None and "fy" not in given:
        yield "missing is how wide it sees: fov_rad (vertical), or fx, fy, cx and cy of its CameraInfo"
    cx, cy = given.get("cx", width / 2), given.get("cy", height / 2)
    if not (width / 4 < cx < width * 3 / 4 and height / 4 < cy < height * 3 / 4):
        yield (
            f"cx {cx:g}, cy {cy:g} are intrinsics of a picture of about {2 * cx:.0f} x {2 * cy:.0f}, "
            f"not of {width} x {height}"
        )
    if "fx" in given and "fy" in given and not 0.5 < given["fx"] / given["fy"] < 2:
        yield f"fx {given['fx']:g} and fy {given['fy']:g} differ by more than half"
    if part.near_m >= part.far_m:
        yield f"near_m {part.near_m:g} is not nearer than far_m {part.far_m:g}"
