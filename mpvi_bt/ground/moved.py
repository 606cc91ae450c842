"""Modules that moved into the wings: their old names load them for one more release, with a warning.

Before the wings, rooms stood on one floor: `mpvi_bt.perception.detector` is now `mpvi_bt.finding.perception.detector`.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

ROOMS: Mapping[str, str] = {  # old room: where its modules are now
    "authoring": "apps.authoring",
    "behaviors": "executive.behaviors",
    "btcpp": "executive.btcpp",
    "choices": "runs.choices",
    "cli": "apps.cli",
    "completion": "executive.completion",
    "datasets": "runs.datasets",
    "disturbances": "runs.disturbances",
    "drawing": "executive.drawing",
    "episode": "runs.episode",
    "executive": "executive.ticking",
    "goals": "house.goals",
    "house": "house.layout",
    "instances": "house.instances",
    "language": "executive.language",
    "learned": "hands.learned",
    "manipulation": "hands",
    "manipulation.motion": "hands.motion",
    "manipulation.policies": "hands.policies",
    "manipulation.skills": "hands.skills",
    "manipulation.stance": "hands.stance",
    "maniskill": "house.maniskill",
    "mcp_server": "apps.mcp_server",
    "monitors": "executive.monitors",
    "navigation": "finding.navigation",
    "perception": "finding.perception",
    "plan": "executive.plan",
    "recording": "runs.recording",
    "remote": "executive.remote",
    "report": "runs.report",
    "robot": "ground.robot",
    "rules": "house.states",
    "scene": "finding.scene",
    "serving": "runs.serving",
    "shapes": "finding.shapes",
    "sim": "house.sim",
    "suite": "runs.suite",
    "things": "house.things",
    "trace": "executive.trace",
    "tree": "executive.tree",
    "watch": "apps.watch",
}
MODULES: Mapping[str, str] = {  # modules that went elsewhere than their room, or stood in none
    "action_chunk": "ground.action_chunk",
    "action_rows": "ground.robot.action_rows",
    "api": "apps.api",
    "base_ramp": "ground.robot.base_ramp",
    "btcpp.malformed": "ground.malformed",
    "btcpp.marked_xml": "ground.marked_xml",
    "cli.given": "apps.cli.argument_types",
    "compiled": "ground.compiled",
    "completion.visual": "finding.perception.visual_checker",
    "cost": "ground.cost",
    "episode.brief": "runs.episode.unscored_result",
    "episode.doers": "runs.episode.capability_checks",
    "errors": "ground.errors",
    "extras": "ground.extras",
    "file_kinds": "ground.file_kinds",
    "goals.next_to": "ground.geometry.next_to",
    "goals.rays": "ground.geometry.rays",
    "goals.spoken": "ground.words.spoken",
    "goals.world_state": "house.states.world_state",
    "import_paths": "ground.import_paths",
    "instances.human": "ground.human",
    "manipulation.policies.backup": "executive.actions.backup",
    "manipulation.policies.chunks": "executive.actions.chunks",
    "manipulation.policies.expert": "house.truth.expert",
    "manipulation.policies.looking": "hands.policies.visual_search",
    "manipulation.policies.showing": "hands.policies.result_views",
    "marked_yaml": "ground.marked_yaml",
    "navigation.lookout": "finding.navigation.camera_mapper",
    "paths": "ground.paths",
    "manipulation.policies.paced": "executive.actions.paced",
    "perception.phrases": "ground.words.phrases",
    "perception.sighting": "finding.perception.located_detections",
    "perception.sizes": "ground.words.sizes",
    "protocols": "ground.protocols",
    "proxies": "ground.proxies",
    "remote.behavior": "hands.behavior_robot.behavior",
    "remote.behavior_layout": "hands.behavior_robot.behavior_layout",
    "remote.briefing": "executive.remote.task_settings",
    "report.several": "runs.report.suite_folders",
    "report.told": "runs.report.suite_report",
    "robot.fetch": "hands.robots.fetch",
    "robot.fetch_urdf": "hands.robots.fetch_urdf",
    "robot.kernels": "ground.geometry.kernels",
    "robot.kinematics": "ground.geometry.kinematics",
    "robot.linear_algebra": "ground.geometry.linear_algebra",
    "robot.r1": "hands.robots.r1",
    "robot.r1_urdf": "hands.robots.r1_urdf",
    "robot.r1pro": "hands.robots.r1pro",
    "robot.r1pro_urdf": "hands.robots.r1pro_urdf",
    "robot.retargeting": "hands.behavior_robot.retargeting",
    "robot.robots": "ground.robot.robots",
    "robot.rotations": "ground.geometry.rotations",
    "robot.solids": "ground.geometry.solids",
    "robot.urdf_writing": "hands.robots.urdf_writing",
    "rules.fire": "house.states.heat",
    "scene.association": "finding.scene.assignment",
    "scene.deeds": "finding.scene.hand_history",
    "scene.held": "finding.scene.hands",
    "scene.in_hand": "finding.scene.handling",
    "scene.knowledge": "executive.plan.knowledge",
    "scene.thing": "finding.scene.thing_store",
    "scene.true_scene": "house.truth.true_scene",
    "sim.baking": "house.states.recipes",
    "sim.blades": "house.states.cutting",
    "sim.cooking": "house.states.grains",
    "sim.marking": "house.states.marks",
    "sim.mounting": "house.states.mounts",
    "sim.switches": "house.states.switches",
    "sim.temperatures": "house.states.heat",
    "standard_streams": "ground.standard_streams",
    "version": "ground.version",
    "writing": "ground.writing",
    "yaml_reader": "ground.yaml_reader",
}


_IMPORTED_WHOLE = ("cli", "maniskill")  # rooms that are imported for themselves
_WINGS = ("executive", "house")  # names of wings today, and of rooms before


def new_name(old: str) -> str | None:
    """The full name that a module of the old layout has now; None: it is none."""
    path = old.removeprefix("mpvi_bt.")
    if path in MODULES:
        return f"mpvi_bt.{MODULES[path]}"
    room, _, module = path.rpartition(".")
    return f"mpvi_bt.{ROOMS[room]}.{module}" if room in ROOMS else None


class OldNames:
    """A finder and loader of modules by their old names, for what Python's own finders do not find."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The way to load `name`, if it is an old one."""
        old = name.removeprefix("mpvi_bt.")
        is_room = old in ROOMS and old not in _WINGS
        if old == name or not (is_room or new_name(old)):
            return None
        return ModuleSpec(name, self, is_package=is_room)  # type: ignore[arg-type]  # no subclass: importing one is slow

    def create_module(self, spec: ModuleSpec) -> None:
        """Leave it to Python."""

    def exec_module(self, module: ModuleType) -> None:
        """Put the module of the new name in its place. Raises ImportError if there is none."""
        old = module.__name__.removeprefix("mpvi_bt.")
        new = f"mpvi_bt.{ROOMS[old]}" if old in ROOMS else new_name(old)
        assert new is not None
        if old not in ROOMS or old in _IMPORTED_WHOLE:
            warnings.warn(f"{module.__name__} is now {new}; the old name goes with the next release", FutureWarning, 2)
        real = importlib.import_module(new)
        if old in ROOMS:  # not the package itself: its modules would load a second time, under the old name
            module.__getattr__ = lambda name: _of_room(old, name)  # type: ignore[method-assign]
        else:
            sys.modules[module.__name__] = real


def _of_room(old: str, name: str) -> object:
    """The object with that name in the old room `old`: a module or an exported name. Raises AttributeError."""
    if name.startswith("__"):
        raise AttributeError(name)
    if hasattr(room := importlib.import_module(f"mpvi_bt.{ROOMS[old]}"), name):
        return getattr(room, name)
    try:
        return importlib.import_module(f"mpvi_bt.{old}.{name}")
    except ModuleNotFoundError:
        raise AttributeError(f"module 'mpvi_bt.{old}' has no attribute {name!r}") from None
