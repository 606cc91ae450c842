"""Tells criteria about an action from criteria about a state (Paper, Subtask Planning).

A state can be told from one picture, "the can is in the trash can"; an action takes a sequence of them, "the robot puts
the can in the trash can". Our choice: the rule names only what is certain, because a good criterion that is refused
costs more than a bad one that is not: what a hand does, orders, what is being done and what has been done. Of the other
sentences, those that say how things stand among them, it says nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache

# What hands and bases do. Holding, standing, facing, supporting and their like last: they are states.
# With a "~": only as an order, "hold the cup"; "the robot holds the cup" is a state, or the word is a noun as well.
_VERBS = """
    put place set lay insert drop release throw toss pick take grab get fetch retrieve collect gather bring deliver give
    move push pull slide drag shove nudge lift raise lower hoist pass hand transfer return carry~ hold~ grasp~ grip~
    keep~ leave open close shut lock unlock turn twist rotate flip press toggle switch plug unplug attach detach connect
    mount hang fold unfold wrap unwrap tie untie screw unscrew stack load unload pack unpack store stow arrange organize
    sort align position assemble pour empty fill shake spray water wipe clean scrub wash rinse dry sweep dust brush mop
    polish cut chop slice dice peel halve stir mix cook heat boil fry bake roast grill toast freeze light ignite
    extinguish go navigate drive walk travel head approach reach arrive enter exit climb remove swap exchange search
    locate find aim swing deposit dump flick hit rub shift sprinkle spritz squirt tip unlatch use~ run~ rest~ stand~
    mist~ tap~ power~ let~ wait~ split cube~
"""
_IRREGULAR = {  # past and participle, where they are not made by a rule
    "put": "put", "set": "set", "cut": "cut", "shut": "shut", "lay": "laid", "leave": "left", "bring": "brought",
    "get": "got gotten", "take": "took taken", "give": "gave given", "throw": "threw thrown", "hang": "hung",
    "sweep": "swept", "light": "lit", "go": "went gone", "drive": "drove driven", "freeze": "froze frozen",
    "shake": "shook shaken", "slide": "slid", "find": "found", "hit": "hit", "split": "split",
}  # fmt: skip
_DOUBLED = {"unplug", "transfer", "unwrap"}  # a last consonant that one syllable alone would double

_ADVERBS = r"(?:(?:please|now|then|just|already|also|first|finally|again|currently|fully|\w+ly) )*"
_WHICH = (
    r"(?:the|an?|it|its|them|this|that|these|those|both|each|every|another|one|two|three|four|five|six|\d+|your|his|"
    r"her|their|some|all(?! over))\b"
)
_PARTICLE = r"(?:(?:up|down|off|out|away|back|aside|open|shut|over|hold of|in|on) )?"
_WHERE = r"(?:to|towards?|into|onto|in|on|at|from|inside|under|over|next|beside|near|through|across|around|with|by)\b"
_END = r"(?= *(?:[,.;!]|$))"
_ROBOT = r"(?:robot|agent)(?:'?s (?:left |right |two )?(?:hand|arm|gripper|base)s?| (?:hand|arm|gripper|base)s?)?"
_PART = r"(?:the |its |both |a |one )?(?:left |right |other |free )?(?:hand|arm|gripper)s?"
_PERSON = r"(?:it|they|you|we|i|he|she|someone|the (?:user|person|human))"
_BEGINS = r"(?:^|[,;.] ?|\b(?:and|then|while|after|once|when|that|until|so) )"
_WHO = rf"(?:\b{_ROBOT}|{_BEGINS}(?:{_PART}|{_PERSON}))"
_PHRASAL = {"pick": "up", "put": "", "bring": "", "fetch": "", "retrieve": "", "remove": "", "navigate": ""}


def action_in(criterion: str) -> str | None:
    """The words of a criterion that tell of an action, such as "the robot puts the"; None if none certainly do."""
    text = " ".join(criterion.lower().replace("\u2019", "'").split())
    for rule in _rules():
        if found := rule.search(text):
            return found.group().strip(" ,.;")
    return None


@cache
def _rules() -> tuple[re.Pattern[str], ...]:
    verbs = [verb for verb in _VERBS.split() if not verb.endswith("~")]
    orders = [verb.rstrip("~") for verb in _VERBS.split()]
    base, third, ing = _any(verbs), _any(map(_third, verbs)), _any(map(_ing, verbs))
    past = _any(form for verb in verbs for form in _past(verb)[:1])
    participle = _any(form for verb in verbs for form in _past(verb)[-1:])
    phrasal = "|".join(f"{verb} {particle}".strip() for verb, particle in _PHRASAL.items())
    phrasal_ing = "|".join(f"{_ing(verb)} {particle}".strip() for verb, particle in _PHRASAL.items())
    follows = rf"(?:(?: {_PARTICLE}{_WHICH})|(?: (?:up|down|off|out|away|back)\b)|(?: {_WHERE})|{_END})"
    modal = (
        r"(?:will|would|shall|should|must|can|could|may|might|did|does|do|(?:needs?|has|have|tries|attempts|manages|"
        r"starts|begins|continues|proceeds|is (?:going|about|able)|are (?:going|about|able)) to)"
    )
    rules = (
        rf"^{_ADVERBS}(?:to )?(?:(?:{phrasal})\b(?! (?:is|are)\b)|{_any(orders)} {_PARTICLE}{_WHICH}|(?:go|move|drive|"
        rf"walk|return|head|travel) (?:back )?(?:to|into|towards?)\b)",
        rf"^{_ADVERBS}(?:by )?(?:(?:{phrasal_ing})\b(?! (?:is|are)\b)|{ing} {_PARTICLE}(?:{_WHICH}|(?:to|towards?)\b))",
        rf"{_WHO} {_ADVERBS}(?:{third}(?! (?:is|are|was|were|has|have)\b)(?<!hands)|hands (?={_WHICH}))",
        rf"{_WHO} {_ADVERBS}{base} {_PARTICLE}{_WHICH}",
        rf"{_WHO} {_ADVERBS}(?:(?:went|drove|walked|navigated|arrived|traveled|reached)\b|{past} {_PARTICLE}{_WHICH})",
        rf"{_WHO} (?:has|have|had) {_ADVERBS}{participle}{follows}",
        rf"{_WHO} (?:is|are|was|were|keeps|starts|begins) {_ADVERBS}(?:done |finished |busy )?{ing}{follows}",
        rf"{_WHO} (?:has |have )?(?:finished|finishes|stopped|stops|completed|completes) {ing}\b",
        rf"{_WHO} {modal} {_ADVERBS}{base}\b",
        rf"\b(?:is|are) {_ADVERBS}{ing} (?:(?:up|down|off|out|away|back) )?{_WHICH}",
        rf"\b(?:is|are|was|were) {_ADVERBS}being {_ADVERBS}{participle}\b",
        rf"\b(?:has|have|had) (?:not )?(?:all |both )?{_ADVERBS}been {_ADVERBS}{participle}\b",
        rf"\b(?:was|were|gets?|got) {_ADVERBS}{participle}\b",
    )
    return tuple(map(re.compile, rules))


def _any(words: Iterable[str]) -> str:
    return rf"\b(?:{'|'.join(sorted(set(words), key=len, reverse=True))})\b"


def _third(verb: str) -> str:
    """The third person, such as "puts", "presses", "carries"."""
    if re.search(r"(?:[sxzo]|ch|sh)$", verb):
        return verb + "es"
    return re.sub(r"(?<=[^aeiou])y$", "ie", verb) + "s"


def _ing(verb: str) -> str:
    """What it is while it is being done, such as "putting", "placing"."""
    if verb.endswith("ie"):
        return verb[:-2] + "ying"
    return re.sub(r"(?<=[^e])e$", "", _doubled(verb)) + "ing"


def _past(verb: str) -> list[str]:
    """Its past and its participle: ["took", "taken"], ["placed", "placed"]."""
    if verb in _IRREGULAR:
        return _IRREGULAR[verb].split()
    stem = re.sub(r"(?<=[^aeiou])y$", "i", _doubled(verb))
    return [stem.removesuffix("e") + "ed"]


def _doubled(verb: str) -> str:
    """With its last consonant doubled if an ending needs it: "putt", "dropp"."""
    short = re.fullmatch(r"[^aeiou]*(?:u(?=[aeio]))?[aeiou][^aeiouwxy]", verb)
    return verb + verb[-1] if short or verb in _DOUBLED else verb


def verbs() -> Iterator[str]:
    """Every verb that the rule knows, in its plain form."""
    return (verb.rstrip("~") for verb in _VERBS.split())
