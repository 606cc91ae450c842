"""Rules that replace nodes by stand-ins, by globs over paths; they can be checked without py_trees.

    about: The trash can slips out of the hand once.
    substitute:
      - nodes: "*/navigate"          # see executive/tree/globs.py
        succeed:
        after: 2.0                   # RUNNING so long before; simulated seconds, or "60 steps"
      - nodes: "*/2 */check_complete"
        fail: not_seen               # a reason code
        times: 1                     # only in its first round
      - nodes: "*/say"
        run: 90 steps                # then success; nothing: forever
      - nodes: "*/manipulate"
        delay: 1.0                   # then what else stands there
      - nodes: "*/set"
        raise: the driver went away  # an exception

The first rule that matches a node wins. After its `times` rounds, and after a delay, the next matching rule applies,
and finally the node itself. Children of a replaced node are not ticked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from mpvi_bt.executive.behaviors.parameters import Duration, Key, Parameters
from mpvi_bt.executive.tree.globs import fits, matching, no_match
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data

if TYPE_CHECKING:
    from py_trees.behaviour import Behaviour

    from mpvi_bt.executive.tree.build import Substitute

Act = Literal["succeed", "fail", "run", "delay", "raise"]

_ACTS: Mapping[str, Act] = {
    "succeed": "succeed",
    "fail": "fail",
    "run": "run",
    "delay": "delay",
    "raise_": "raise",
}
# Our choice: long enough to be seen on the way, short enough that the dry run of a long tree is over at once.
_DRY: Mapping[str, tuple[Act, float | None]] = {
    "navigate": ("succeed", 2.0),
    "check_complete": ("succeed", 2.0),
    "manipulate": ("run", None),
}
_DRY_ELSE: tuple[Act, float | None] = ("succeed", 1.0)


class Rule(Parameters):
    """What stands in for some nodes: exactly one of succeed, fail, run, delay and raise."""

    nodes: Annotated[str, Field(min_length=1, max_length=1000)]
    succeed: None = None
    fail: Key | None = None
    run: Duration | None = None
    delay: Duration | None = None
    raise_: Annotated[str, Field(max_length=300)] | None = Field(default=None, alias="raise")
    after: Duration | None = None
    times: Annotated[int, Field(ge=1, le=1_000_000)] | None = None

    @model_validator(mode="after")
    def _one_act(self) -> Rule:
        given = [act for field, act in _ACTS.items() if field in self.model_fields_set]
        if len(given) != 1:
            raise ValueError(
                f"a rule needs one of succeed, fail, run, delay and raise, not {', '.join(given) or 'none'}"
            )
        if given == ["delay"] and self.delay is None:
            raise ValueError("'delay' needs a duration")
        if self.after is not None and given[0] in ("run", "delay"):
            raise ValueError(f"'after' does not go with {given[0]!r}, which says itself how long")
        return self

    @property
    def act(self) -> Act:
        """Which of them."""
        return next(act for field, act in _ACTS.items() if field in self.model_fields_set)


class RulesFile(Record):
    """The keys at the top of a file of rules."""

    about: Annotated[str, Field(max_length=300)] = ""
    substitute: Annotated[list[Rule], Field(min_length=1, max_length=1000)]


@dataclass(frozen=True)
class Rules:
    """A file of rules.

    Attributes:
        rules: In order: the first that fits wins.
        marks: Where they stand.
    """

    rules: Sequence[Rule]
    marks: SourceMarks

    def check(self, tree: TreeSpec) -> None:
        """Raise FileProblems if a rule fits no node of the tree."""
        problems = [
            self.marks.problem(("substitute", i, "nodes"), "no-such-node", no_match(rule.nodes, tree))
            for i, rule in enumerate(self.rules)
            if not matching(rule.nodes, tree)
        ]
        if problems:
            raise FileProblems(problems)

    def source(self, index: int) -> str:
        """Where a rule stands, such as "rules.yaml:12"."""
        return f"{self.marks.file}:{self.marks.at(('substitute', index))[0]}"


def load_rules(path: str | Path) -> Rules:
    """The rules in a file.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_rules(*load_marked(path))


def check_rules(data: Any, marks: SourceMarks) -> Rules:
    """As `load_rules`, of data that is already loaded."""
    expect("file of rules", data, marks)
    return Rules(validate_data(data, marks, RulesFile).substitute, marks)


def stand_ins(rules: Rules | None = None, dry: bool = False) -> Substitute:
    """What `Tree` takes as `substitute`.

    Args:
        rules: They come first.
        dry: Whether every other node that needs a robot gets a stand-in too: what drives succeeds after 2 s, and so
            does a completion check; a policy runs; anything else succeeds after 1 s.
    """
    from mpvi_bt.executive.behaviors.stand_ins import StandIn

    def stand_in(placed: Placed, make: Callable[[], Behaviour]) -> Behaviour:
        fitting = [i for i, rule in enumerate(rules.rules) if fits(rule.nodes, placed.path)] if rules else []
        return chain(placed.spec, fitting, make)

    def chain(spec: NodeSpec, fitting: Sequence[int], make: Callable[[], Behaviour]) -> Behaviour:
        name = spec.name or spec.kind
        if not fitting or rules is None:
            if not (dry and spec.type.robot):
                return make()
            act, after = _DRY.get(spec.kind, _DRY_ELSE)
            return StandIn(
                name, act, after, texts=tuple(v for v in dict(spec.parameters).values() if isinstance(v, str))
            )
        index, *others = fitting
        rule = rules.rules[index]
        needs_other = rule.times is not None or rule.act == "delay"
        return StandIn(
            name,
            "succeed" if rule.act == "run" and rule.run is not None else rule.act,
            rule.run or rule.delay or rule.after,
            {"fail": rule.fail or "failed", "raise": rule.raise_ or "an exception"}.get(rule.act, ""),
            rules.source(index),
            rule.times,
            chain(spec, others, make) if needs_other else None,
        )

    return stand_in
