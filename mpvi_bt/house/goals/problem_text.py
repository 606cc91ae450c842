"""Reads the text of a BDDL problem, and finds everything that is wrong with it.

Upstream's quirks are kept, because scores must agree: of a goal only its first formula counts (what stands beside the
`and` is dropped), an object may be listed twice, and stray words between the sections, such as a backslash, mean
nothing. `mpvi check` tells of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.ground.errors import shown, with_article
from mpvi_bt.house.goals.expressions import SECTIONS, Expression, Form, Word, read_expressions, written
from mpvi_bt.house.goals.findings import Findings
from mpvi_bt.house.goals.formula import Fact
from mpvi_bt.house.goals.grounding import NO_LITERAL, Grounding
from mpvi_bt.house.goals.vocabulary import BddlVocabulary, unknown_synset

AGENT = "agent.n.01"
_PLACES = ("ontop", "inside", "under", "nextto", "overlaid", "attached", "draped", "touching", "future")
_HOLDS = ("filled", "covered", "contains", "insource", "saturated")  # a substance, named second
_PASSED_OVER = ("problem", ":domain", ":requirements")

_WORD = re.compile(r"[^\s()]+")
_SYNSET = re.compile(r"(\S+\.[nvasr]\.\d\d)_(?:\d+|\*)$")  # of an object, as BEHAVIOR names it


@dataclass(frozen=True)
class ProblemText:
    """What a text says. Attributes: as of `problem.BddlProblem`."""

    objects: Mapping[str, str]
    wildcards: Mapping[str, str]
    init: tuple[Fact, ...]
    goal: Expression


def read_problem(text: str, findings: Findings, known: BddlVocabulary) -> ProblemText:
    """The problem of a text.

    Args:
        text: Of the file.
        findings: Take in what is wrong, warnings and notes too.
        known: The names that may be used.

    Raises:
        FileProblems: Everything that is wrong with it.
    """
    sections = _sections(_define(text, findings), findings)
    listed, starred = _objects(sections[":objects"], findings, known)
    objects = {str(name): str(synset) for name, synset in listed.items()}
    grounding = Grounding(objects, starred, findings, known)
    facts = [(item, _fact(item, grounding)) for item in sections[":init"][1:]]
    goal = sections[":goal"][1]
    grounding.conditions(goal)
    rooms = _rooms(facts, findings)
    if known.predicates is not None:  # else nothing is known of what they mean
        _check_places(listed, starred, facts, findings, known)
    findings.check()
    wildcards = {synset: rooms.get(word, "") for synset, word in starred.items()}
    init = tuple(fact for _, fact in facts if not any(arg.endswith("_*") for arg in fact.literal.args))
    return ProblemText(objects, wildcards, init, goal)


def _define(text: str, findings: Findings) -> Form:
    """The (define ...) form; nothing else may be in the file."""
    expressions = read_expressions(text, findings)
    define = next((e for e in expressions if isinstance(e, Form) and e[:1] == ["define"]), None)
    if define is None:
        message = "no (define ...): a problem is (define (problem NAME) (:objects ...) (:init ...) (:goal ...))"
        findings.stop(expressions[0].place if expressions else (1, 1), "syntax", message)
    if any(isinstance(part, Form) and part[:1] == ["domain"] for part in define):
        findings.stop(define.place, "wrong-kind", "this is a domain, not a problem; BEHAVIOR's own is always read")
    for other in expressions:
        if other is not define:
            where = f"after the ')' that closes '(define', on line {define.end[0]}"
            where = where if other.place > define.end else "before '(define'"
            findings.problem(other.place, "syntax", f"{shown(written(other))} stands {where}; a file holds one problem")
            break
    return define


def _sections(define: Form, findings: Findings) -> dict[str, Form]:
    """The sections by name, all of them. Raises FileProblems if one is missing."""
    found: dict[str, Form] = {}
    for part in define[1:]:
        if not isinstance(part, Form) or not part or not isinstance(part[0], Word):
            message = f"{shown(written(part))} stands between the sections and means nothing"
            findings.problem(part.place, "stray-text", message, severity="note")
        elif part[0] in found:
            findings.problem(
                part.place, "repeated", f"a second {part[0]}; the first is on line {found[part[0]].place[0]}"
            )
        elif part[0] in SECTIONS:
            found[part[0]] = part
        elif part[0] not in _PASSED_OVER:
            findings.unknown(part[0].place, "section", part[0], (*SECTIONS, *_PASSED_OVER))
    if missing := [section for section in SECTIONS if section not in found]:
        findings.stop(define.place, "missing-key", f"the problem has no {', '.join(f'({s} ...)' for s in missing)}")
    if ":goal" in found and len(found[":goal"]) < 2:
        findings.stop(found[":goal"].place, "empty-formula", "the problem has no :goal formula")
    for more in found.get(":goal", Form())[2:3]:
        message = "only the first formula of a goal counts, to bddl too; join them: (:goal (and formula ...))"
        findings.problem(more.place, "second-goal", message, severity="warning")
    return found


def _objects(section: Form, findings: Findings, known: BddlVocabulary) -> tuple[dict[Word, Word], dict[str, Word]]:
    """Objects with their synsets, and synsets with a wildcard."""
    objects: dict[Word, Word] = {}
    starred: dict[str, Word] = {}
    waiting: list[Word] = []
    following = iter(section[1:])
    for word in following:
        if isinstance(word, Form):
            findings.problem(word.place, "invalid-value", f"{shown(written(word))}: :objects holds OBJECT ... - SYNSET")
            continue
        if word != "-":
            waiting.append(word)
            continue
        synset = next(following, None)
        if not isinstance(synset, Word):
            findings.problem((synset or word).place, "invalid-value", "after '-' comes a synset, such as cup.n.01")
            continue
        if not waiting:
            findings.problem(word.place, "invalid-value", f"no object before '- {synset:.40}'")
        if unknown := known.synsets is not None and synset not in known.synsets:
            findings.problem(synset.place, **unknown_synset(synset, known.synsets))
        for item in waiting:
            if (named := _SYNSET.match(item)) is not None and named[1] != synset and not unknown:
                message = f"{item:.60} is listed as {synset:.60}: is '- {named[1]:.60}' missing after it?"
                findings.problem(item.place, "wrong-synset", message)
            if item.endswith("_*"):
                starred[str(synset)] = item
            elif item not in objects:
                objects[item] = synset
            elif objects[item] == synset:
                findings.problem(item.place, "repeated", f"{item:.60} is listed twice", severity="note")
            else:
                findings.problem(item.place, "repeated", f"{item:.60} is {with_article(objects[item][:60])} already")
        waiting = []
    if waiting:
        message = f"'- SYNSET' is missing after {', '.join(waiting[:3])}{' ...' * (len(waiting) > 3)}"
        findings.problem(waiting[0].place, "invalid-value", message)
    return objects, starred


def _fact(item: Expression, grounding: Grounding) -> Fact:
    match item:
        case ["not", denied]:
            return Fact(grounding.literal(denied, starred=True), positive=False)
    return Fact(grounding.literal(item, starred=True))


def _rooms(facts: list[tuple[Expression, Fact]], findings: Findings) -> dict[str, str]:
    """What `inroom` says, of wildcards too."""
    rooms: dict[str, str] = {}
    for item, fact in facts:
        if fact.literal.predicate == "inroom" and fact.positive and len(fact.literal.args) == 2:
            thing, room = fact.literal.args
            if rooms.setdefault(thing, room) != room:
                findings.problem(item.place, "two-rooms", f"{thing} is in the {rooms[thing]} already")
    return rooms


def _check_places(
    objects: Mapping[Word, Word],
    starred: Mapping[str, Word],
    facts: list[tuple[Expression, Fact]],
    findings: Findings,
    known: BddlVocabulary,
) -> None:
    """Note objects without a place in :init. Objects in unreadable facts are not noted."""
    said = [fact.literal for _, fact in facts if fact.positive]
    unread = {word for item, fact in facts if fact.literal == NO_LITERAL for word in _WORD.findall(written(item))}
    in_room = {literal.args[0] for literal in said if literal.predicate == "inroom"}
    placed = {literal.args[0] for literal in said if literal.predicate in _PLACES}
    placed |= {literal.args[-1] for literal in said if literal.predicate in _HOLDS}
    for name, synset in ((name, objects.get(name)) for name in (*objects, *starred.values())):
        if name in in_room or name in placed or name in unread:
            continue
        if synset is None or synset in known.fixtures:
            message = f":init does not say in which room {name} is: (inroom {name} ROOM) is missing"
            findings.problem(name.place, "missing-room", message)
        else:
            message = f":init does not say where {name} is, such as (ontop {name} floor.n.01_1)"
            findings.problem(name.place, "missing-place", message)
