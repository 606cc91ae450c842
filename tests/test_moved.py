"""Modules of the time before the wings load by their old names, with a warning, for one more release."""

from __future__ import annotations

import importlib
import importlib.util
import sys

import pytest

from mpvi_bt.ground.moved import MODULES, ROOMS, new_name

# What the pages and skeletons of the release before told people to import.
TOLD = {
    "mpvi_bt.behaviors.node": ("Leaf",),
    "mpvi_bt.behaviors.parameters": ("Parameters",),
    "mpvi_bt.behaviors.registry": ("NodeType",),
    "mpvi_bt.manipulation.motion.approach": ("approach", "arrive", "leave", "lines", "withdraw"),
    "mpvi_bt.manipulation.motion.carry": ("settle",),
    "mpvi_bt.manipulation.motion.gaze": ("study",),
    "mpvi_bt.manipulation.skills.press": ("options", "press"),
    "mpvi_bt.perception.detector": ("Detection", "Detector"),
    "mpvi_bt.plan.clauses": ("match",),
    "mpvi_bt.plan.planners": ("Planner",),
    "mpvi_bt.plan.schema": ("Phrase", "Plan"),
    "mpvi_bt.plan.skills": ("load_skills",),
    "mpvi_bt.protocols": ("Checker", "Judgement", "Navigator", "Policy", "Triggers"),
    "mpvi_bt.robot.kinematics": ("transform",),
    "mpvi_bt.robot.motion": ("MotionFailure",),
    "mpvi_bt.tree.compile": ("compile_plan",),
    "mpvi_bt.tree.spec": ("TreeSpec",),
    "mpvi_bt.tree.yaml_io": ("load_tree",),
    "mpvi_bt.cli": ("main",),
}


@pytest.mark.parametrize("old", TOLD)
def test_an_old_name_loads_the_module_and_tells_the_new_one(old: str) -> None:
    """The same objects, so that checks by class go on working."""
    new = new_name(old) or f"mpvi_bt.{ROOMS[old.removeprefix('mpvi_bt.')]}"
    sys.modules.pop(old, None)
    with pytest.warns(FutureWarning, match=new):
        loaded = importlib.import_module(old)
    here = importlib.import_module(new)
    assert all(getattr(loaded, name) is getattr(here, name) for name in TOLD[old])


def test_every_name_in_the_table_leads_to_a_module() -> None:
    """Rooms and modules alike; and a name that never was is an error as always."""
    assert all(importlib.util.find_spec(f"mpvi_bt.{new}") for new in {*ROOMS.values(), *MODULES.values()})
    with pytest.raises(ModuleNotFoundError, match=r"mpvi_bt\.nothing"):
        importlib.import_module("mpvi_bt.nothing")


def test_a_name_of_a_room_is_imported_from_it() -> None:
    """`from mpvi_bt.robot import rotations`, though rotations stand elsewhere now."""
    from mpvi_bt.ground.geometry import rotations as now

    with pytest.warns(FutureWarning):
        then = getattr(importlib.import_module("mpvi_bt.robot"), "rotations")  # noqa: B009
    assert then is now
