"""Random trees of every kind of node, for property tests."""

from __future__ import annotations

from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.parameters import (
    Assignment,
    Comparison,
    CriterionToCheck,
    Limit,
    MemoryFlag,
    NamedPosture,
    NavigateTo,
    NoParameters,
    OnFailure,
    ParallelSuccess,
    Pause,
    Prompt,
    Reason,
    SaidText,
    Times,
    Tries,
    Turn,
)
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec

words = st.text(st.characters(categories=["L", "N", "P", "S", "Zs"]), min_size=1, max_size=20).map(str.strip).filter(
    lambda t: bool(t) and t.isprintable()
) | st.sampled_from(
    [
        "1",
        "null",
        "on",
        "1e3",
        "~",
        "- a",
        "a: b",
        "#x",
        "'",
        '"',
        "timeout",
        "{a",
        "*x",
        "!y",
        "$cup",
        "the ${cup}",
        "$$",
    ]
)
keys = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
numbers = st.integers(-999, 999).map(float) | st.floats(-1e6, 1e6)
values = st.booleans() | st.integers(-999, 999) | st.floats(-1e6, 1e6) | words
durations = st.floats(1e-3, 1e4) | st.integers(1, 9999).map(lambda n: f"{n} steps")
segments = st.lists(st.integers(0, 99), max_size=3).map(tuple)
comparisons = st.builds(
    Comparison,
    key=keys,
    equals=st.none() | values,
    not_equals=st.none() | values,
    at_least=st.none() | numbers,
    at_most=st.none() | numbers,
)
_leaf_parameters = {
    "navigate": st.builds(NavigateTo, target=words, room=st.none() | words),
    "manipulate": st.builds(Prompt, prompt=words),
    "check_complete": st.builds(CriterionToCheck, criterion=words, skill=st.none() | words),
    "posture": st.just(NamedPosture(posture="travel")),
    "look_around": st.builds(Turn, degrees=st.none() | st.floats(-720, 720)),
    "wait": st.builds(Pause, duration=durations),
    "say": st.builds(SaidText, text=words),
    "set": st.builds(Assignment, key=keys, value=values) | st.builds(Assignment, key=keys, add=numbers),
    "test": comparisons,
    "succeed": st.just(NoParameters()),
    "fail": st.builds(Reason, reason=st.none() | keys),
}
_one_child = {
    "attempt": st.builds(OnFailure, on_failure=st.sampled_from(["advance", "replan"])),
    "invert": st.just(NoParameters()),
    "timeout": st.builds(Limit, limit=durations),
    "cooldown": st.builds(Limit, limit=durations),
    "retry": st.builds(Tries, tries=st.integers(1, 1000)),
    "repeat": st.builds(Times, times=st.integers(1, 1000)),
    "condition": comparisons,
}
_many_children = {
    "sequence": st.builds(MemoryFlag, memory=st.booleans()),
    "selector": st.builds(MemoryFlag, memory=st.booleans()),
    "parallel": st.builds(ParallelSuccess, policy=st.sampled_from(["success_on_all", "success_on_one"])),
    "until_complete": st.just(NoParameters()),
}
KINDS = {*_leaf_parameters, *_one_child, *_many_children}


def _names(kind: str) -> st.SearchStrategy[str]:
    named = {"sequence", "selector", "parallel", "until_complete", "attempt", "invert", "succeed"}
    return st.just("") | words if kind in named else st.just("")


def _nodes(kind: str, parameters: st.SearchStrategy, children: st.SearchStrategy) -> st.SearchStrategy[NodeSpec]:
    return st.builds(NodeSpec, st.just(kind), parameters, _names(kind), children, segments)


leaves = st.one_of([_nodes(kind, parameters, st.just(())) for kind, parameters in _leaf_parameters.items()])


def above(inner: st.SearchStrategy[NodeSpec]) -> st.SearchStrategy[NodeSpec]:
    many = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        *(_nodes(kind, parameters, st.tuples(inner)) for kind, parameters in _one_child.items()),
        *(_nodes(kind, parameters, many) for kind, parameters in _many_children.items()),
    )


trees = st.builds(
    TreeSpec,
    words,
    st.recursive(leaves, above, max_leaves=10),
    instruction=st.just("") | words,
    about=st.just("") | words,
    blackboard=st.dictionaries(keys, values, max_size=3),
)
