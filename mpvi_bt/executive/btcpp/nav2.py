"""Trees of ROS's Nav2 in nodes that are read here.

There, a tree plans a path again and again, follows it, and clears maps; `navigate` does all that by itself. So what
plans is left out, what follows a path becomes a drive to the goal that it was planned to, and recovery becomes retries.
Basis: the source of Nav2's nodes and trees, main branch of August 2026.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

from mpvi_bt.executive.btcpp.file import Needs, XmlFile, below, made, place_of, tag_of
from mpvi_bt.executive.btcpp.format import CONDITIONS
from mpvi_bt.executive.btcpp.mapping import KEY, is_pointer
from mpvi_bt.ground.marked_xml import Element

_PLANS = """
    AppendGoalPoseToGoals ArePosesNear CancelControl ClearCostmapAroundPose ClearCostmapAroundRobot
    ClearCostmapExceptRegion ClearEntireCostmap ComputeAndTrackRoute ComputePathThroughPoses ComputePathToPose
    ComputeRoute ConcatenatePaths ControllerSelector ExtractRouteNodesAsGoals GetCurrentPose GetNextFewGoals
    GetPoseFromPath GoalCheckerSelector IsGoalNearby IsPathValid PathExpiringTimer PathHandlerSelector
    PathLongerOnApproach PlannerSelector ProgressCheckerSelector RemoveInCollisionGoals RemovePassedGoals SmoothPath
    SmootherSelector TruncatePath TruncatePathLocal ValidatePath WouldAControllerRecoveryHelp WouldAPlannerRecoveryHelp
    WouldARouteRecoveryHelp WouldASmootherRecoveryHelp
"""
_PLANNING = frozenset(_PLANS.split())  # with what is below them
_NEW_GOAL = frozenset({"GlobalUpdatedGoal", "GoalUpdated"})
_DRIVES = {"FollowPath": "path", "NavigateToPose": "goal", "NavigateThroughPoses": "goals"}
_USED: Mapping[str, tuple[str, ...]] = {  # attributes that mean something here of nodes that become others
    **{tag: (port,) for tag, port in _DRIVES.items()},
    "PipelineSequence": ("name",),
    "RecoveryNode": ("name", "number_of_retries"),
    "RoundRobin": ("name", "wrap_around"),
    "Spin": ("spin_dist",),
}
_FROM = {  # output ports, with the inputs that say where their path or goal leads
    "path": ("goal", "goals"),
    "smoothed_path": ("unsmoothed_path",),
    "output_path": ("input_path", "input_path2"),
    "output_goal": ("input_goal",),
    "output_goals": ("input_goals",),
}
_FALLBACKS = frozenset({"Fallback", "ReactiveFallback", "RoundRobin"})
_COMPOSITES = _FALLBACKS | {"PipelineSequence", "ReactiveSequence", "Sequence"}
_ACTIONS = frozenset({"AssistedTeleop", "BackUp", "DriveOnHeading"})  # without an equal here
NEAREST = {
    "AssistedTeleop": "a person at the page of `mpvi run --serve --step`",
    "BackUp": "navigate with 'elsewhere: true'",
    "DistanceController": "cooldown",
    "DockRobot": "navigate",
    "DriveOnHeading": "navigate",
    "NonblockingSequence": "ReactiveSequence",
    "PersistentSequence": "Sequence",
    "RateController": "cooldown",
    "SpeedController": "cooldown",
    "UndockRobot": "navigate",
}


def rewritten(file: XmlFile, name: str) -> Element:
    """The <BehaviorTree> of a name without Nav2's nodes, as far as they have an equal here."""
    tree = file.trees[name]
    pass_ = _Rewriting(file, tree, file.needs.setdefault(name, Needs()))
    root = pass_.node(tree.children[0], "")
    if root is None:
        file.problem(tree.children[0], "unmapped-node", "this tree only plans, and navigate plans by itself here")
        return tree
    if pass_.left_out:
        tags = ", ".join(f"{tag} (line {element.place[0]})" for tag, element in pass_.left_out.items())
        file.warn(tree.children[0], "nav2", f"navigate plans by itself, so these are left out: {tags}")
    if pass_.ports:
        ports = ", ".join(f"{name} (line {place[0]})" for name, place in pass_.ports.items())
        file.warn(tree.children[0], "nav2", f"these ports mean nothing here and are left out: {ports}")
    return replace(tree, children=[root])


class _Rewriting:
    """Of one tree.

    Attributes:
        left_out: Nodes that plan, by their tags, the first of each.
        ports: Ports that mean nothing here, such as "Spin time_allowance", with the place of the first of each.
    """

    def __init__(self, file: XmlFile, tree: Element, needs: Needs) -> None:
        self.file, self.tree, self.needs = file, tree, needs
        self.left_out: dict[str, Element] = {}
        self.ports: dict[str, tuple[int, int]] = {}
        self.sources = _sources(tree)
        self._known: dict[int, bool] = {}

    def node(self, element: Element, above: str) -> Element | None:
        """A node in what is read here, below one of the tag `above`; None: it is left out."""
        tag = tag_of(element)
        if self._plans(element):
            self._leave_out(element)
            return None
        if tag in _NEW_GOAL and above in _FALLBACKS and not _conditions(element):
            self.left_out.setdefault(tag, element)
            return None
        for name in element.attributes if tag in _USED else ():
            if name not in (*_USED[tag], "ID") and not name.startswith("_"):
                self.ports.setdefault(f"{tag} {name}", place_of(element, name))
        if not element.children and (leaf := self._leaf(element, tag)) is not None:
            return leaf
        pairs = [(child, self.node(child, tag)) for child in element.children]
        children = [found for _, found in pairs if found is not None]
        if tag in _FALLBACKS:
            children = self._alternatives(pairs, tag) or children
        if pairs and not children:
            return _instead(element, "AlwaysSuccess")
        unwraps = (tag in _COMPOSITES and len(pairs) > 1) or tag == "GoalUpdater"
        if unwraps and len(children) == 1 and not _conditions(element):
            return children[0]
        if tag == "RecoveryNode" and len(pairs) == 2 and pairs[0][1] is not None:
            return self._recovery(element, children)
        if tag == "RoundRobin" and children:
            return self._round_robin(element, children)
        if tag == "PipelineSequence" and children:
            message = "here a child of a PipelineSequence that runs again cuts off those after it"
            self.file.warn(element, "pipelinesequence", message)
            return replace(_instead(element, "ReactiveSequence", **_only(element, "name")), children=children)
        return replace(element, children=children)

    def _leaf(self, element: Element, tag: str) -> Element | None:
        """What a leaf is here; None: it stays as it is."""
        if tag in _PLANNING:
            return _instead(element, "AlwaysSuccess")
        if tag in _NEW_GOAL:
            return _instead(element, "AlwaysFailure", name="goal_not_updated")  # no goal is replaced here
        if tag in _DRIVES:
            return self._drive(element, tag)
        if tag == "Spin" and (angle := _number(element.attributes.get("spin_dist", "1.57"))) is not None:
            return _instead(element, "LookAround", degrees=f"{math.degrees(angle):.0f}")
        if tag == "Wait" and "wait_duration" in element.attributes:
            return _instead(element, "Wait", duration=element.attributes["wait_duration"])
        return None

    def _plans(self, element: Element) -> bool:
        """Whether a node, with all below it, only plans, or looks whether it has to."""
        if _conditions(element):
            return False
        if id(element) not in self._known:
            inner = element.children[:1] if tag_of(element) == "RecoveryNode" else element.children
            plans = [self._plans(child) for child in inner]
            self._known[id(element)] = tag_of(element) in _PLANNING or (
                any(plans) and all(plan or _asks(child) for plan, child in zip(plans, inner, strict=True))
            )
        return self._known[id(element)]

    def _leave_out(self, element: Element) -> None:
        if not element.children or tag_of(element) in _PLANNING:
            self.left_out.setdefault(tag_of(element), element)
        else:
            for child in element.children:
                self._leave_out(child)

    def _alternatives(self, pairs: list[tuple[Element, Element | None]], above: str) -> list[Element]:
        """Those of several children that have an equal here; the others are left out if there are any."""
        kept = [found for child, found in pairs if found is not None and tag_of(child) not in _ACTIONS]
        for child, _ in pairs if kept else ():
            if (tag := tag_of(child)) in _ACTIONS:
                message = f"{tag} has no equal here and is left out; the others of this {above} are tried"
                self.file.warn(child, "nav2", f"{message}. The nearest is {NEAREST[tag]}")
        return kept

    def _drive(self, element: Element, tag: str) -> Element:
        """A drive to where a path leads."""
        port = _DRIVES[tag]
        goal = self._origin(element.attributes.get(port, f"{{{port}}}").strip("{} "), port != "path")
        if goal is None:
            message = f"nothing in this tree plans the {port} that {tag} follows; say where to with Navigate target="
            self.file.problem(element, "unmapped-node", message, port)
            return _instead(element, "AlwaysSuccess")
        if goal == "goals" or port == "goals":
            message = f"Navigate drives to one target: {goal!r} is one here; call the tree once for each"
            self.file.warn(element, "nav2", message)
        if not KEY.fullmatch(goal):
            self.file.problem(element, "port-value", f"{goal!r:.40} is no reference here: keys are like 'goal_2'", port)
            return _instead(element, "AlwaysSuccess")
        self.needs.texts[goal] = None
        return _instead(element, "Navigate", target=f"{{{goal}}}")

    def _origin(self, key: str, is_goal: bool) -> str | None:
        """The goal that the path, or the goal, of a key comes from, the last in the file; None: nothing says so."""
        left, seen = [(key, is_goal)], set()
        while left:
            key, is_goal = left.pop()
            sources = self.sources.get(key, [])
            if is_goal and not sources:
                return key
            if key not in seen:
                seen.add(key)
                left += sources
        return None

    def _recovery(self, element: Element, children: list[Element]) -> Element:
        self._refuse_skips(children)
        tries = element.attributes.get("number_of_retries", "1")
        count = str(int(tries) + 1) if re.fullmatch("[0-9]{1,6}", tries.strip()) else tries
        body = children[0]
        if len(children) > 1:
            again = made(element, "AlwaysFailure", name="try_again")
            recovery = replace(made(element, "Sequence", name="recovery"), children=[children[1], again])
            body = replace(made(element, "Fallback", **_only(element, "name")), children=[body, recovery])
            message = "here the recovery is done after the last try too, and if it fails the next try begins"
            self.file.warn(element, "recoverynode", f"RecoveryNode: {message}")
        return replace(_instead(element, "RetryUntilSuccessful", num_attempts=count), children=[body])

    def _round_robin(self, element: Element, children: list[Element]) -> Element:
        """Turns by a key of the blackboard: who is next is known when it begins again."""
        self._refuse_skips(children)
        if element.attributes.get("wrap_around", "").lower() in ("true", "1"):
            message = "here the child after the last is the first only when the node begins again"
            self.file.warn(element, "roundrobin", f"RoundRobin: {message}", "wrap_around")
        key = self.file.free_key("round_robin")
        self.needs.first_values[key] = 0
        turns = []
        for i, child in enumerate(children):
            mine = made(element, "ScriptCondition", code=f"{key} == {i}")
            next_ = made(element, "Script", code=f"{key} := {(i + 1) % len(children)}")
            turns.append(replace(made(element, "Sequence", name=f"turn {i + 1}"), children=[mine, next_, child]))
        return replace(_instead(element, "Fallback", **_only(element, "name")), children=turns)

    def _refuse_skips(self, children: list[Element]) -> None:
        for child in children:
            for name in ("_skipIf", "_while"):
                if name in child.attributes:
                    message = f"{name} has no equal here right below a node of Nav2; the nearest is ConditionNode"
                    self.file.problem(child, "unmapped-attribute", message, name)


def _sources(tree: Element) -> Mapping[str, list[tuple[str, bool]]]:
    """For each key of a path or goal that a node sets: the keys it comes from, each marked if it is a goal."""
    found: dict[str, list[tuple[str, bool]]] = {}
    for element in below(tree):
        for port, inputs in _FROM.items():
            for name in inputs:
                key, source = element.attributes.get(port, ""), element.attributes.get(name, "")
                if is_pointer(key) and is_pointer(source) and key != source:
                    found.setdefault(key.strip("{} "), []).append((source.strip("{} "), "goal" in name))
    return found


def _asks(element: Element) -> bool:
    """Whether a node only asks for a new goal."""
    inner = element.children
    return tag_of(element) in _NEW_GOAL or (tag_of(element) == "Inverter" and len(inner) == 1 and _asks(inner[0]))


def _instead(element: Element, tag: str, **attributes: str) -> Element:
    """Another node in the place of one, with its pre- and postconditions."""
    return Element(tag, {**attributes, **_conditions(element)}, element.place, element.places)


def _conditions(element: Element) -> dict[str, str]:
    return {name: text for name, text in element.attributes.items() if name in CONDITIONS}


def _only(element: Element, name: str) -> dict[str, str]:
    return {name: element.attributes[name]} if name in element.attributes else {}


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
