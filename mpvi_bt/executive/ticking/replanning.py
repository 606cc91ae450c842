"""A new plan where a part of the old one failed: the planner is asked, and its plan put into the tree between ticks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Context, Failure, Log, Replan
from mpvi_bt.executive.behaviors.question import Question
from mpvi_bt.executive.behaviors.references import unescaped
from mpvi_bt.executive.language.chat import Answer
from mpvi_bt.executive.plan.history import History, SeenObject, Unit
from mpvi_bt.executive.plan.knowledge import LIKELY, Entry
from mpvi_bt.executive.plan.planners import NoPlan, Planner
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import Arrange, Drive, compile_units
from mpvi_bt.executive.tree.spec import Placed, TreeSpec
from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.errors import BackendError, UserError

MOST = 3  # questions to a planner that does not say; Our choice: what failed three times over is not mended by a fourth
_ANSWERS = 2  # of the checker, the last
_LONGEST = 300  # characters of why there is no plan
_NUMBER = re.compile(r"\d+ ")


class Replanner:
    """Implements the protocol that `attempt` knows.

    A new plan is for the rest of the work. What is done stays in the tree, and so does what was given up; the new units
    follow, numbered on. Where the planner fails, has no valid plan, or has been asked `most` times in this episode, the
    old plan advances, and the run's log says why.

    Args:
        planner: Whom to ask; in a thread if it is `remote`.
        tree: Into which the plans go.
        context: Of the run.
        instruction: What the tree is to carry out; "": what it says itself.
        seen: What the robot knows of things, when it is asked.
        swapped: Called with the new tree after each swap.
        drive, arrange: Of new plans, as of `compile_plan`.
        late_s: What each answer takes besides, in simulated time [s], by its number in the episode.
        full: Hands that feel something between their fingers, when it is asked; None: nobody knows.
    """

    def __init__(
        self,
        planner: Planner,
        tree: Tree,
        context: Context,
        instruction: str = "",
        seen: Callable[[], Iterable[SeenObject]] = tuple,
        swapped: Callable[[TreeSpec], object] = lambda spec: None,
        drive: Drive = "navigator",
        arrange: Arrange | None = None,
        late_s: Callable[[int], float] = lambda answer: 0.0,
        full: Callable[[], tuple[str, ...] | None] = lambda: None,
    ) -> None:
        self._planner, self._tree, self._context = planner, tree, context
        self._instruction, self._seen, self._swapped = instruction, seen, swapped
        self._most, self._drive = getattr(planner, "most", MOST), drive
        self._arrange, self._late_s, self._full = arrange, late_s, full
        self._open: list[_Request] = []

    def ask(self, path: str, failure: Failure) -> _Request:
        """Ask for a plan for all that follows the `attempt` at `path`."""
        log = self._context.log
        answered = next((r for r in log.replans if r.path == path and r.time_s >= failure.time_s), None)
        if answered is not None:  # before the run was stopped
            return _Request(path, log, _came_to(answered.segments, answered.said))
        if row_of(self._tree.spec, path) is None:
            return _Request(path, log, "no new plan: it is no child of a sequence with memory")
        if len(log.replans) >= self._most:
            return _Request(path, log, f"no new plan: {self._most} were asked for already")
        history = history_of(self._tree, self._context, path, failure, self._seen(), self._full())
        instruction = self._instruction or self._tree.spec.instruction
        late_s = self._late_s(len(log.replans))
        question = Question(
            partial(_rest, self._planner, self._tree.spec.name, instruction, history),
            self._context.clock,
            lambda rest: rest.latency_s + late_s,
            at_once=not getattr(self._planner, "remote", False),
        )
        self._open.append(_Request(path, log, "asking for a new plan", question))
        return self._open[-1]

    def swap(self) -> None:
        """Put the plans into the tree that are there."""
        for request in self._open:
            # Whoever waited for it may have been interrupted since.
            if request.rest is not None and self._tree.nodes[request.path].status is Status.RUNNING:
                self._swap(request, request.rest)
        self._open = [request for request in self._open if request.question is not None and request.rest is None]

    def _swap(self, request: _Request, rest: _Replanned) -> None:
        spec, path = self._tree.spec, request.path
        row = row_of(spec, path) or (path,)
        place = row.index(path) + 1
        gone = tuple(f"{later}/" for later in row[place:])
        kept = (node.spec.segments for node in spec.nodes if not f"{node.path}/".startswith(gone))
        index = 1 + max((i for segments in kept for i in segments), default=-1)
        plan = rest.plan
        skills = self._context.skills
        units = compile_units(plan, skills, "replan", self._drive, place + 1, index, self._arrange) if plan else ()
        try:
            self._tree.swap_after(path, units)
        except (UserError, BackendError) as error:
            request.refuse(error)
            return
        request.close(len(plan.segments) if plan else 0)
        self._swapped(self._tree.spec)


@dataclass(frozen=True)
class _Replanned:
    """The planner's answer: a plan, nothing left to do, or an error."""

    plan: Plan | None
    answers: Sequence[Answer] = ()
    error: NoPlan | None = None

    @property
    def latency_s(self) -> float:
        return sum(answer.latency_s for answer in self.answers)

    @property
    def cost(self) -> Cost | None:
        """Of all answers together."""
        if not self.answers:
            return None
        tokens_in, tokens_out = (sum(getattr(a, way) for a in self.answers) for way in ("tokens_in", "tokens_out"))
        return Cost(self.answers[-1].model, tokens_in, tokens_out, all(answer.kept for answer in self.answers))


def _rest(planner: Planner, name: str, instruction: str, history: History) -> _Replanned:
    """Ask for a new plan. A failure after some planning time is an answer too; other errors are raised."""
    try:
        planned = planner.ask(name, instruction, history)
    except NoPlan as error:
        return _Replanned(None, error.answers, None if error.reason == "nothing_left" else error)
    return _Replanned(planned.plan, planned.answers)


class _Request:
    """Implements `behaviors.context.Request`.

    Args:
        path: Of the `attempt` that waits.
        log: Of the run.
        note: How it stands, a few words.
        question: To the planner; None: it is not asked.

    Attributes:
        rest: The answer, from when it is there until it is in the tree.
    """

    def __init__(self, path: str, log: Log, note: str, question: Question[_Replanned] | None = None) -> None:
        self.path, self.note, self.question = path, note, question
        self.rest: _Replanned | None = None
        self._log = log

    def waits(self) -> bool:
        """Until there is no plan to be had, or the new one is in the tree."""
        if self.question is not None and self.rest is None:
            try:
                self.rest = self.question.answer()
                if self.rest is not None and self.rest.error is not None:
                    raise self.rest.error
            except (UserError, BackendError) as error:
                self.refuse(error)
        return self.question is not None

    def close(self, segments: int) -> None:
        """The new plan is in the tree."""
        self._close(segments, "")

    def refuse(self, error: UserError | BackendError) -> None:
        """There is no new plan: the old one advances."""
        said = " ".join(str(error).split())
        said = said if len(said) <= _LONGEST else said[: _LONGEST - 3] + "..."
        self._close(None, said)

    def _close(self, segments: int | None, said: str) -> None:
        assert self.question is not None
        asked_s, rest = self.question.asked_s, self.rest
        latency_s, cost = (rest.latency_s, rest.cost) if rest else (0.0, None)
        self._log.replans.append(Replan(self.path, segments, said, asked_s, latency_s, cost))
        self.note, self.question, self.rest = _came_to(segments, said), None, None


def _came_to(segments: int | None, said: str) -> str:
    if segments is None:
        return f"no new plan: {said}"
    return f"new plan: {segments} segment{'s' * (segments != 1)}"


def history_of(
    tree: Tree,
    context: Context,
    path: str,
    failure: Failure,
    seen: Iterable[SeenObject] = (),
    full: tuple[str, ...] | None = None,
) -> History:
    """The history for replanning: units before the failed `attempt` at `path`, its failure, and the units after it."""
    row = row_of(tree.spec, path) or (path,)
    placed = {node.path: node for node in tree.spec.nodes}
    place = row.index(path)
    units = [
        _unit(context, placed, sibling, getattr(tree.nodes.get(sibling), "failure", None)) for sibling in row[:place]
    ]
    units.append(_unit(context, placed, path, failure))
    planned = tuple(_said(placed, later) for later in row[place + 1 :])
    return History(tuple(units), planned, tuple(seen), full)


def things(known: Iterable[Entry]) -> list[SeenObject]:
    """Things seen, of a knowledge base: carried ones first, then the surest; nothing of a prior map."""
    by_name = {entry.name: entry for entry in known}
    seen = [e for e in by_name.values() if e.kind != "room" and e.source != "prior" and e.confidence >= LIKELY]
    return [
        SeenObject(_called(e), e.room, _called(by_name[e.inside]) if e.inside in by_name else e.inside, e.held)
        for e in sorted(seen, key=lambda e: (not e.held, e.kind != "object", -e.confidence))
    ]


def _called(entry: Entry) -> str:
    return entry.phrases[0] if entry.phrases else entry.name


def row_of(spec: TreeSpec, path: str) -> tuple[str, ...] | None:
    """The children of the sequence with memory that a node is a child of, or None if it is none."""
    above = next((node for node in spec.nodes if path in node.children), None)
    memory = above is not None and above.spec.kind == "sequence" and getattr(above.spec.parameters, "memory", False)
    return above.children if above is not None and memory else None


def _unit(context: Context, placed: Mapping[str, Placed], path: str, failure: Failure | None) -> Unit:
    said, criterion = _said(placed, path), _criterion(placed, path)
    if failure is None:
        return Unit(said, criterion=criterion)
    asked = [query for query in context.log.queries if query.path.startswith(f"{path}/")]
    answers = (f"{query.criterion}? {query.said}: {query.reason}" for query in asked[-_ANSWERS:])
    return Unit(said, failure.reason, failure.evidence, tuple(answers), criterion)


def _criterion(placed: Mapping[str, Placed], path: str) -> str:
    """The last criterion that is checked below a node."""
    own = getattr(placed[path].spec.parameters, "criterion", None)
    found = [own and unescaped(own), *(_criterion(placed, child) for child in placed[path].children)]
    return next((criterion for criterion in reversed(found) if criterion), "")


def _said(placed: Mapping[str, Placed], path: str) -> str:
    """A node's task: the prompt below it (a name would cut it short), or its name without the number."""
    node = inner = placed[path]
    while inner.children:
        inner = placed[inner.children[0]]
    prompt = getattr(inner.spec.parameters, "prompt", None)
    return unescaped(prompt) if prompt is not None else _NUMBER.sub("", node.spec.name, count=1) or node.spec.label
