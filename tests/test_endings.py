"""The end of a plan is not success: wherever the end of a run is told, its q comes first, then what was given up."""

from __future__ import annotations

import io
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.drawing.endings import ENDED, ended
from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import Outcome, Subscriber, Watcher, World, run_episode
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.html import trace_page
from mpvi_bt.executive.trace.read import Trace, read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.substitute import load_rules, stand_ins
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.runs.recording.path_picture import PathPicture, path_picture
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.conftest import Shell
from tests.navigation_maps import two_rooms
from tests.test_recorders import SKILLS, SPEC

GOAL = GoalReport(False, 1 / 3, 1 / 3, (GoalCondition("inside(can, bin)", False), GoalCondition("open(door)", True)))


class Order(Watcher):
    """Notes whether the goal was known when the run ended."""

    known: list[bool]

    def start(self, tree: Tree, world: World) -> None:
        """Nothing yet."""
        self.known = []

    def end(self, outcome: Outcome) -> None:
        """What is known now."""
        self.known.append(outcome.goal is not None)


def plan_without_hands(folder: Path, *watchers: Subscriber, goal: GoalReport = GOAL) -> Outcome:
    """A plan of which every unit of the hands is given up, so that it comes to its end at a third of its goal."""
    (folder / "rules.yaml").write_text("substitute:\n  - nodes: '*/manipulate'\n    fail: gave_up\n")
    world = KinematicWorld()
    context = scripted_context(world, SKILLS, {"trash can": (0.2, 0.0), "can of soda": (0.0, 0.2)}, {})
    tree = Tree(SPEC, stand_ins(load_rules(folder / "rules.yaml")))
    return run_episode(tree, world, context, watchers, score=lambda: goal)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Trace, str, Path]:
    """How it ended in a line, its trace, what was shown live, and its picture."""
    folder, shown = tmp_path_factory.mktemp("plan"), io.StringIO()
    picture, order = folder / "way.png", Order()
    watchers: list[Subscriber] = [
        order,
        Recorder(folder / "t.jsonl"),
        LiveTree(shown, "x"),
        PathPicture(picture, two_rooms(), title="trash"),
    ]
    outcome = plan_without_hands(folder, *watchers)
    assert order.known == [True]
    return outcome.told(SPEC), read_trace(folder / "t.jsonl"), shown.getvalue(), picture


def test_the_line_leads_with_q(told: tuple[str, Trace, str, Path]) -> None:
    """And says that the plan came to its end, and how much of it was given up, as another fact."""
    assert re.fullmatch(r"q = 0\.333, plan finished after \d\.\d s, 4 units given up", told[0])


def test_it_is_the_same_wherever_a_run_is_told(told: tuple[str, Trace, str, Path]) -> None:
    """Live, in the trace, in its explanation and page, and over the picture."""
    line, trace, shown, picture = told
    assert shown.splitlines()[-1] == line == trace.told
    explained = explanation_text(explain(trace), 100).splitlines()
    assert explained[0] == f"picking_up_trash: {line}, tick {trace.last_tick}"
    assert explained[1:3] == ["  1 of 2 conditions of the goal hold", "  not met: inside(can, bin)"]
    assert '"text":"' + line in trace_page(trace)
    expected = path_picture(two_rooms(), np.zeros((1, 3)), R1.base.outline, title=f"{line}   trash")
    drawn = cv2.imread(str(picture))
    assert drawn is not None
    assert (drawn[:25, :, ::-1] == expected[:25]).all()


def test_a_page_marks_the_end_by_its_goal(told: tuple[str, Trace, str, Path], tmp_path: Path) -> None:
    """A run that falls short is none that is marked as a success; one that reaches its goal is."""
    assert '"is":"failure","tick":' in trace_page(told[1])
    plan_without_hands(tmp_path, Recorder(tmp_path / "t.jsonl"), goal=GoalReport(True, 1.0, 1.0, GOAL.conditions[1:]))
    assert '"is":"success","tick":' in trace_page(read_trace(tmp_path / "t.jsonl"))


@given(st.sampled_from(sorted(ENDED)), st.integers(0, 9), st.booleans())
def test_without_a_goal_there_is_no_q(ending: str, given_up: int, plan: bool) -> None:
    """And none of the words of a plan's end is the word of a node's success."""
    line = ended(ending, given_up, plan, 1.0)
    assert "q =" not in line
    assert ("given up" in line) is (given_up > 0)
    assert not (plan and "succe" in line)


def test_a_dry_run_that_gave_units_up_is_no_success(mpvi: Shell, tmp_path: Path) -> None:
    """Its tree has succeeded all the same, and so has the command."""
    (tmp_path / "rules.yaml").write_text("substitute:\n  - nodes: '*/manipulate'\n    fail: gave_up\n")
    done = mpvi("run", "picking_up_trash", "--dry", "--no-watch", "--substitute", "rules.yaml")
    assert done.returncode == 0
    assert done.stdout.startswith("FINISHED  dry run: plan finished, 4 units given up\n")
