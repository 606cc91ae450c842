"""The kinds of files that mpvi_bt reads and writes, and how each is told from the others, whatever it is named."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpvi_bt.ground.errors import FileProblems, Problem, nearest, shown
from mpvi_bt.ground.yaml_reader import SourceMarks


@dataclass(frozen=True)
class FileKind:
    """A kind of file: any of `keys` tells it, or else the name of its folder.

    Attributes:
        name: For a person, with its article.
        keys: At the top of such a file, and not of others.
        folder: Where such files lie.
        use: What takes it.
        check: "module:function", called with the data and the marks of a file; raises FileProblems. None: they are
            written by mpvi_bt and have nothing to check.
        lint: "module:function", called with the same of a file without errors; returns what else there is to say.
    """

    name: str
    keys: frozenset[str]
    folder: str
    use: str
    check: str | None = None
    lint: str | None = None

    @property
    def noun(self) -> str:
        """Its name without the article."""
        return self.name.removeprefix("a ")


KINDS = (
    FileKind(
        "a tree",
        frozenset({"tree", "root"}),
        "trees",
        "mpvi run --tree FILE",
        "mpvi_bt.executive.tree.yaml_io:check_tree",
    ),
    FileKind(
        "a plan",
        frozenset({"task_name", "segments"}),
        "plans",
        "mpvi compile FILE",
        "mpvi_bt.executive.plan.schema:check_plan",
    ),
    FileKind(
        "a skill",
        frozenset({"phrases", "triggers"}),
        "skills",
        "a folder skills/ in MPVI_PATH",
        "mpvi_bt.executive.plan.skills:check_skill",
        "mpvi_bt.runs.episode.capability_checks:lint_skill",
    ),
    FileKind(
        "a house",
        frozenset({"rooms", "doorways"}),
        "houses",
        "a task's 'house'",
        "mpvi_bt.house.layout.house:check_house",
    ),
    FileKind(
        "a kind of house",
        frozenset({"day", "night", "corridor_m", "garden"}),
        "kinds",
        "a folder tasks/kinds/ in MPVI_PATH",
        "mpvi_bt.house.generated.house_kind:check_kind",
    ),
    FileKind(
        "a suite",
        frozenset({"tasks", "instances", "seeds"}),
        "suites",
        "mpvi suite run FILE",
        "mpvi_bt.runs.suite.suites:check_suite",
    ),
    FileKind(
        "a method",
        frozenset({"policy", "detector", "checker", "trigger", "planner", "map", "drive", "on_failure", "while_asked"}),
        "methods",
        "mpvi run --method FILE",
        "mpvi_bt.runs.choices.methods:check_method",
    ),
    FileKind(
        "a task",
        frozenset({"problem", "bindings"}),
        "tasks",
        "mpvi run FILE",
        "mpvi_bt.house.instances.tasks:check_task",
        "mpvi_bt.runs.symbolic.symbolic_planner:lint_task",
    ),
    FileKind(
        "a catalogue",
        frozenset({"entries"}),
        "catalogues",
        "a folder tasks/catalogues/ in MPVI_PATH",
        "mpvi_bt.house.things.catalogue:check_catalogue",
        "mpvi_bt.house.things.catalogue:lint_catalogue",
    ),
    FileKind(
        "a file of rules",
        frozenset({"substitute"}),
        "rules",
        "mpvi run --substitute FILE",
        "mpvi_bt.executive.tree.substitute:check_rules",
    ),
    FileKind(
        "a policy",
        frozenset({"observation", "action", "connect_s", "answer_s", "reset_message"}),
        "policies",
        "a folder policies/ in MPVI_PATH",
        "mpvi_bt.executive.remote.dialect_settings:check_settings",
    ),
    FileKind(
        "a bridge",
        frozenset({"joint_states", "odometry", "cameras", "base", "grippers", "watchdog_s", "lockstep"}),
        "bridges",
        "mpvi ros2 --bridge FILE",
        "mpvi_bt.runs.ros2.bridge_file:check_bridge",
    ),
    FileKind(
        "a robot",
        frozenset({"urdf", "base", "cameras", "arms", "grippers"}),
        "robots",
        "--robot FILE",
        "mpvi_bt.ground.robot.robot_reading:check_robot_file",
        "mpvi_bt.ground.robot.robot_reading:lint_robot_file",
    ),
    FileKind("a saved run", frozenset({"saved", "config", "measurement", "run"}), "", "mpvi run --resume FILE"),
    FileKind(
        "a result of an episode", frozenset({"q_score", "goal_fraction", "rollout_id", "config"}), "", "mpvi suite"
    ),
    FileKind("a JSON schema", frozenset({"$schema", "$defs", "definitions"}), "schema", "an editor"),
)
_TEXTS = (  # what is neither YAML nor JSON of ours, by its beginning
    (re.compile(r"\s*\{\s*\"trace\"\s*:"), "the trace of a run", "mpvi replay FILE` and `mpvi explain FILE"),
    (re.compile(r"\s*(?:<[?!][^>]*>\s*)*<robot\b"), "a URDF", "mpvi new robot NAME --urdf FILE"),
    (re.compile(r"\s*<[?!A-Za-z]"), "XML", "mpvi convert FILE OUT.yaml"),
)


def kind_of(data: Any, marks: SourceMarks) -> FileKind:
    """The kind of file with most of its top-level keys. Raises FileProblems."""
    keys = set(data) if isinstance(data, dict) else set()
    folder = Path(marks.file).resolve().parent.name
    kind = max(KINDS, key=lambda k: (len(keys & k.keys), k.folder == folder))
    if not keys & kind.keys and kind.folder != folder:
        for key in filter(lambda key: isinstance(key, str), keys):
            if near := nearest(key, [name for kind in KINDS if kind.check for name in kind.keys]):
                message = f"unknown key {shown(key)}, in a file of no known kind. Did you mean {near!r}?"
                raise FileProblems([marks.problem((key,), "unknown-file", message, key=True, nearest=near)])
        known = "; ".join(f"{kind.noun} ({', '.join(sorted(kind.keys)[:2])})" for kind in KINDS if kind.check)
        raise FileProblems([marks.problem((), "unknown-file", f"what is this? Known by their keys: {known}")])
    return kind


def expect(name: str, data: Any, marks: SourceMarks) -> None:
    """Raise FileProblems if the keys of a file tell that it is of another kind than `name`, such as "tree"."""
    keys = set(data) if isinstance(data, dict) else set()
    due = next(kind for kind in KINDS if kind.noun == name)
    kind = max(KINDS, key=lambda k: len(keys & k.keys))
    if len(keys & kind.keys) > len(keys & due.keys):
        raise FileProblems([marks.problem((), "wrong-kind", f"this is {kind.name}, not {due.name}; {taken_by(kind)}")])


def taken_by(kind: FileKind) -> str:
    """The use of a kind of file, in words."""
    return f"it is for {f'`{kind.use}`' if kind.use.startswith('mpvi') else kind.use}"


def foreign(text: str, name: str) -> Iterator[Problem]:
    """The problem of a text that is neither YAML nor JSON, if its beginning shows its format."""
    for beginning, what, use in _TEXTS:
        if beginning.match(text):
            yield Problem(name, 1, 1, "wrong-kind", f"this is {what}, not YAML; it is for `{use}`")
            return
