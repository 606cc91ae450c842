"""A robot's data sheet as text."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from mpvi_bt.executive.drawing.cells import WIDTH
from mpvi_bt.executive.drawing.text_table import aligned

_TIED = "\u00a0"  # a space at which no line ends
_JOINTS = {
    "absolute": "targets of joints [rad or m]",
    "delta": "how far joints' targets go in each action [rad or m]",
    "velocity": "how fast joints go [rad/s or m/s]",
}
_HEAD = ("", "lowest", "highest", "top speed", "driving")


def sheet_text(sheet: dict[str, Any]) -> str:
    """The sheet in lines of at most 80 columns, but for long names."""
    about = f": {sheet['about']}" if sheet["about"] else ""
    lines = _wrapped(f"{sheet['robot']}{about}", "")
    lines += [f"  {sheet['file']}, URDF {sheet['urdf']}", ""]
    lines += [*_base(sheet["base"]), ""]
    if sheet["torso"]:
        lines += ["torso and head", *_joints(sheet["torso"]), ""]
    for side, arm in sheet["arms"].items():
        lines += [*_arm(side, arm), *_gripper(side, sheet["grippers"][side]), ""]
    for name, camera in sheet["cameras"].items():
        lines += _camera(name, camera)
    return "\n".join([*lines, "", *_actions(sheet["actions"])])


def _base(base: dict[str, Any]) -> Iterator[str]:
    sideways = base["speed"].get("sideways")
    how = "goes any way" if sideways is not None else "ahead, back and turning"
    above = f", {base['above_floor_m']:g} m above the floor" if base["above_floor_m"] else ""
    yield f"base: {base['kind']} ({how}); its frame is that of {base['link']}{above}"
    outline = base["footprint_m"]
    if isinstance(outline, float):
        shape = f"round, radius {outline:g} m; {base['kept_clear_m']:.2f} m are kept clear with folded arms"
    else:
        length, width = (max(c[k] for c in outline) - min(c[k] for c in outline) for k in (0, 1))
        shape = f"{len(outline)} corners, {length:.3g} m long and {width:.3g} m wide"
    yield f"  footprint   {shape}"
    aside = f"{sideways:g} m/s sideways, " if sideways is not None else ""
    speed, more = base["speed"], base["acceleration"]
    yield f"  at most     {speed['ahead']:g} m/s ahead, {aside}{speed['turn']:g} rad/s turning"
    yield f"              {more['ahead']:g} m/s^2, {more['turn']:g} rad/s^2"


def _joints(joints: Sequence[dict[str, Any]]) -> list[str]:
    """A table of joints."""
    rows = [_HEAD]
    for joint in joints:
        unit, (low, high) = joint["unit"], joint["limits"]
        does = f" ({joint['does']})" if "does" in joint else ""
        figures = f"{low:.2f}", f"{high:.2f} {unit}", f"{joint['top_speed']:.2f} {unit}/s", f"{joint['travel']:.2f}"
        rows.append((joint["name"] + does, *figures))
    return [f"  {line}" for line in aligned(rows, left=(0,))]


def _arm(side: str, arm: dict[str, Any]) -> list[str]:
    low, high = arm["tcp_heights_m"]
    lowest = f"{low:.2f} m" if low > 0 else "the floor"
    return [
        f"{side} arm: reaches {arm['reach_m']:.2f} m from its first joint, which is {arm['shoulder_m'][2]:.2f} m high;",
        f"  its tcp gets from {lowest} to {high:.2f} m high",
        *_joints(arm["joints"]),
    ]


def _gripper(side: str, gripper: dict[str, Any]) -> list[str]:
    named = [f"{j['name']} {j['closed']:g} to {j['open']:g} {j['unit']}" for j in gripper["joints"]]
    fingers = ", ".join(named) or "the URDF has no joint of it"
    opening, grasp = (100 * gripper[key] for key in ("opening_m", "grasp_m"))
    return _wrapped(
        f"{side} gripper: opens {opening:.3g} cm; holds something if {grasp:.2g} cm wider than told; {fingers}", "  "
    )


def _camera(name: str, camera: dict[str, Any]) -> list[str]:
    across, high = (math.degrees(angle) for angle in camera["fov_rad"])
    size, depth, tilt = camera["size"], camera["depth_m"], math.degrees(camera["down_rad"])
    sees = f"depth {depth[0]:g} to {depth[1]:g} m" if depth else "no depth"
    where = f"{abs(tilt):.0f} degrees {'down' if tilt > 0 else 'up'}" if abs(tilt) >= 0.5 else "straight ahead"
    return _wrapped(
        f"{name} camera: {size[0]} x {size[1]} px, {across:.0f} x {high:.0f} degrees, {sees}; "
        f"{camera['height_m']:.2f} m high and looking {where} as it drives; on {camera['link']}",
        "  ",
    )


def _actions(actions: dict[str, Any]) -> list[str]:
    numbers = actions["numbers"]
    listed = ", ".join(f"{i}{_TIED}{number['name']}" for i, number in enumerate(numbers))
    rows = f"{len(numbers)} numbers, {actions['rate_hz']:g} times a second"
    what = f"velocities of the base [m/s, rad/s], {_JOINTS[actions['kind']]}, grippers -1 closed to 1 open"
    return [
        *_wrapped(f"actions: {rows}: {what}", "  "),
        *(f"  {line.replace(_TIED, ' ')}" for line in _wrapped(listed, "", WIDTH - 2)),
    ]


def _wrapped(text: str, indent: str, width: int = WIDTH) -> list[str]:
    return textwrap.wrap(text, width, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)
