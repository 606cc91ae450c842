"""Nodes and attributes of BehaviorTree.CPP that no node of ours is, but several are together."""

from __future__ import annotations

from dataclasses import replace

from mpvi_bt.executive.btcpp.file import XmlFile, made, tag_of
from mpvi_bt.executive.btcpp.format import POSTCONDITIONS, PRECONDITIONS
from mpvi_bt.executive.btcpp.mapping import KEY, is_pointer
from mpvi_bt.ground.errors import shown
from mpvi_bt.ground.marked_xml import Element

NEAREST = {
    "IfThenElse": "a Fallback of Sequences that begin with a ScriptCondition",
    "KeepRunningUntilFailure": "Repeat, as nothing is done for ever here",
    "LoopBool": "Repeat",
    "LoopDouble": "Repeat",
    "LoopInt": "Repeat",
    "LoopString": "Repeat",
    "ParallelAll": "Parallel",
    "SequenceWithMemory": "a Sequence whose children are each tried again by RetryUntilSuccessful",
    "UnsetBlackboard": "SetBlackboard",
    "WhileDoElse": "a ReactiveFallback of ReactiveSequences that begin with a ScriptCondition",
}
_SEQUENCES = frozenset({"AsyncSequence", "PipelineSequence", "ReactiveSequence", "Sequence"})
_FALLBACKS = frozenset({"AsyncFallback", "Fallback", "ReactiveFallback"})
_AFTER = tuple(name for name in POSTCONDITIONS if name != "_onHalted")


def rewritten(file: XmlFile, element: Element, above: str = "") -> Element:
    """A node and its children, rewritten in supported nodes; `above`: the tag of its parent."""
    tag = tag_of(element)
    children = [rewritten(file, child, tag) for child in element.children]
    own = {name: text for name, text in element.attributes.items() if name not in (*PRECONDITIONS, *_AFTER)}
    node = replace(element, attributes=own, children=children)
    named = {key: own[key] for key in ("name",) if key in own}
    one = children[:1] or [made(element, "AlwaysSuccess")]  # another number of children is told already
    if tag == "Delay":
        node = _around(element, "Sequence", made(element, "Sleep", msec=own.get("delay_msec", "1")), *one)
        node = replace(node, attributes=named)
    elif tag == "ForceFailure":
        forced = _around(element, "ForceSuccess", *one)
        node = _around(element, "Sequence", forced, made(element, "AlwaysFailure", name="forced"))
        node = replace(node, attributes=named)
    elif tag == "Precondition":
        node = replace(_precondition(file, element, one[0], above), attributes=named)
    elif tag.startswith("Switch") and tag[6:].isdigit():
        node = _switch(file, node, int(tag[6:]))
    return _conditions(file, element, node, above)


def _conditions(file: XmlFile, element: Element, node: Element, above: str) -> Element:
    """The node within what its pre- and postconditions say."""
    before = [name for name in PRECONDITIONS if name in element.attributes]
    for name in before[1:]:
        message = f"{name} beside {before[0]}: one precondition of a node has an equal here; put a node around it"
        file.problem(element, "unmapped-attribute", message, name)
    name = before[0] if before else ""
    skips = {"_skipIf": "_successIf" if above in _SEQUENCES else "_failureIf", "_while": "_while"}
    if name in skips and above not in (_FALLBACKS if name == "_while" else _SEQUENCES | _FALLBACKS):
        where = "a Fallback" if name == "_while" else "a Sequence or a Fallback"
        message = f"{name} has an equal here only right below {where}; the nearest is ConditionNode around the node"
        file.problem(element, "unmapped-attribute", message, name)
        return node
    if name in ("_failureIf", "_successIf"):
        node = _guarded(element, node, name, name)
    for key in _AFTER:
        if key in element.attributes:
            node = _after(element, node, key)
    return _guarded(element, node, name, skips[name]) if name in skips else node


def _guarded(element: Element, node: Element, name: str, as_: str) -> Element:
    """A node below a condition from an attribute; the attribute decides the kind of parent."""
    asked = _script(element, "ScriptCondition", name)
    if as_ == "_while":
        return _around(element, "ReactiveSequence", asked, node)
    if as_ == "_successIf":
        return _around(element, "Fallback", asked, node)
    return _around(element, "Sequence", _around(element, "Inverter", asked), node)


def _after(element: Element, node: Element, name: str) -> Element:
    """A node with the script of an attribute after it."""
    if name in ("_onSuccess", "_post"):
        node = _around(element, "Sequence", node, _script(element, "Script", name))
    if name in ("_onFailure", "_post"):
        failed = _around(element, "Sequence", _script(element, "Script", name), made(element, "AlwaysFailure"))
        node = _around(element, "Fallback", node, failed)
    return node


def _precondition(file: XmlFile, element: Element, child: Element, above: str) -> Element:
    """A node that begins only if a script holds."""
    otherwise = element.attributes.get("else", "FAILURE")
    if otherwise == "SKIPPED" and above in _SEQUENCES | _FALLBACKS:
        otherwise = "SUCCESS" if above in _SEQUENCES else "FAILURE"
    if otherwise not in ("SUCCESS", "FAILURE"):
        message = f"else: {shown(otherwise)} has no equal here; FAILURE and SUCCESS have"
        file.problem(element, "unmapped-attribute", message, "else")
    asked = _script(element, "ScriptCondition", "if") if "if" in element.attributes else made(element, "AlwaysSuccess")
    if otherwise == "SUCCESS":
        return _around(element, "Fallback", _around(element, "Inverter", asked), child)
    return _around(element, "Sequence", asked, child)


def _switch(file: XmlFile, element: Element, cases: int) -> Element:
    """A fallback with a condition before each child; the last child is the default."""
    variable = element.attributes.get("variable", "")
    key = variable.strip("{} ")
    if not is_pointer(variable) or not KEY.fullmatch(key):
        file.problem(element, "port-value", f"{variable!r:.40} is no reference here: keys are like 'cup_2'", "variable")
    elif len(element.children) != cases + 1:
        message = f"{tag_of(element)} takes {cases + 1} children, the last for all else, not {len(element.children)}"
        file.problem(element, "children", message)
    elif missing := [name for i in range(cases) if (name := f"case_{i + 1}") not in element.attributes]:
        file.problem(element, "missing-port", f"{tag_of(element)} needs the port {missing[0]!r}")
    else:
        texts = [element.attributes[f"case_{i + 1}"] for i in range(cases)]
        *chosen, last = element.children
        for text in texts:
            last = replace(made(element, "ConditionNode", key=key, not_equals=text), children=[last])
        each = [
            replace(made(element, "ConditionNode", key=key, equals=text), children=[child])
            for text, child in zip(texts, chosen, strict=True)
        ]
        named = {name: element.attributes[name] for name in ("name",) if name in element.attributes}
        return replace(made(element, "ReactiveFallback", **named), children=[*each, last])
    return made(element, "AlwaysSuccess")


def _script(element: Element, tag: str, name: str) -> Element:
    """A node with the script that stands in an attribute."""
    found = made(element, tag, code=element.attributes[name])
    return replace(found, places={"code": element.places.get(name, element.place)})


def _around(element: Element, tag: str, *children: Element) -> Element:
    return replace(made(element, tag), children=list(children))
