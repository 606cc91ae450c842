"""Static analysis of how the nodes of a tree can end.

Conservative: a node counts as never failing, or never ending, only if that is certain, because warnings are based on
it.
"""

from __future__ import annotations

from mpvi_bt.executive.behaviors.references import names_in
from mpvi_bt.executive.tree.spec import NodeSpec

Outcomes = frozenset[str]

BOTH: Outcomes = frozenset({"success", "failure"})
SUCCESS: Outcomes = frozenset({"success"})
FAILURE: Outcomes = frozenset({"failure"})
NEVER: Outcomes = frozenset()

_LEAVES = {"manipulate": FAILURE, "check_complete": SUCCESS, "wait": SUCCESS, "succeed": SUCCESS, "fail": FAILURE}


def outcomes(node: NodeSpec, known: dict[int, Outcomes]) -> Outcomes:
    """What a node may end with: success, failure, both, or nothing if it never ends by itself.

    Args:
        node: Any.
        known: By id of the node, what was found before; takes up what is found now.
    """
    if id(node) not in known:
        ends = _of_kind(node, [outcomes(child, known) for child in node.children])
        known[id(node)] = ends | FAILURE if _may_lack_a_value(node) else ends
    return known[id(node)]


def _of_kind(node: NodeSpec, below: list[Outcomes]) -> Outcomes:
    match node.kind:
        case "sequence":
            return _in_order(below, "success", "failure")
        case "selector":
            return _in_order(below, "failure", "success")
        case "parallel":
            last = below if node.parameters.policy == "success_on_all" else None  # type: ignore[attr-defined]
            return _side_by_side(below, all("success" in ends for ends in last) if last else _any(below, "success"))
        case "until_complete":
            return _side_by_side(below, "success" in below[-1])
        case "attempt":
            return SUCCESS if below[0] else NEVER
        case "timeout" | "condition" | "cooldown":
            return below[0] | FAILURE
        case "invert":
            return frozenset({"success": "failure", "failure": "success"}[end] for end in below[0])
        case "retry" | "repeat" | "subtree":
            return below[0]
        case "set":
            return SUCCESS if node.parameters.add is None else BOTH  # type: ignore[attr-defined]
        case "say":
            return SUCCESS
        case _:
            return _LEAVES.get(node.kind, BOTH)


def _in_order(below: list[Outcomes], goes_on: str, stops: str) -> Outcomes:
    """Of children of which each is begun once the one before `goes_on`."""
    found: set[str] = set()
    for ends in below:
        found |= ends & {stops}
        if goes_on not in ends:
            return frozenset(found)
    return frozenset(found | {goes_on})


def _side_by_side(below: list[Outcomes], succeeds: bool) -> Outcomes:
    return (SUCCESS if succeeds else NEVER) | (FAILURE if _any(below, "failure") else NEVER)


def _any(below: list[Outcomes], end: str) -> bool:
    return any(end in ends for ends in below)


def _may_lack_a_value(node: NodeSpec) -> bool:
    """Whether it fails if a blackboard key in its texts has no value."""
    return node.kind != "subtree" and any(isinstance(v, str) and names_in(v) for v in vars(node.parameters).values())
