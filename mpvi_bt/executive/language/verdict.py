"""Reads yes or no from a model's answer: untrusted text of any length and form."""

from __future__ import annotations

import re

from mpvi_bt.executive.language.thinking import spoken

LONGEST = 1000  # characters of an answer


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# The word, maybe in emphasis or quotation marks; then nothing more, or what sets it off from the next word.
_BEGINNING = re.compile(r"""[\s*_`"'#>]*([Yy][Ee][Ss]|[Nn][Oo])(?![\w])([\s\S]*)""")
_ALONE = re.compile(r"""[\s.!*_`"']*""")
_SET_OFF = re.compile(r"""[*_`"']*(?:[.,;:!]*[*_`"']*\s|-{1,2}\s|[\u2013\u2014])""")
_READABLE = re.compile(r"[\s!-~\u00a1-\u024f\u2010-\u2026]*")  # Latin: other scripts may take back what we can't read
_WORD = re.compile(r"[^\W\d_]+(?:'[^\W\d_]+)?")

# Second thoughts, questions and notations, whatever the answer began with.
_TURNS = _words(
    "wait actually correction corrected scratch oops hmm misread misspoke edit update disregard ignore strike cancel "
    "contrary opposite reverse rather kidding joking inspection reflection deny denied dispute"
)
_TURNING_STEMS = ("apolog", "mistake", "reconsider", "revis", "retract", "withdr", "refut")
_TURNING = re.compile(
    r"[?/\\|{}<>=%]|\b(?:(?:second|another|closer) (?:thought|look|glance)|hold on|tak(?:e|ing) (?:that|it|this) back)"
)
_NOT = _words("no n not cannot nope nah nay never none nothing nobody nowhere neither nor without non nein nicht")
_SURE = re.compile(
    r"\b(?:without (?:a |any )?doubt|(?:there is |there's )?no doubt(?: about (?:it|that))?|undoubtedly)\b"
)

# What takes a yes back besides: a no in other words, a restriction, another time, a doubt, or talk of something else.
_AGAINST_YES = _words(
    "false negative incomplete incompletely unfinished uncompleted undone unsatisfied unfulfilled unmet untrue unable "
    "unsure uncertain unclear unlikely unseen unverified unconfirmed unknown invalid insufficient inconsistent "
    "inconclusive indeterminate invisible impossible improbable missing misses absent wrong wrongly error gone "
    "but however although though except yet unless if whether until otherwise instead despite nevertheless nonetheless "
    "only almost nearly part partly half hardly barely scarcely mostly mainly largely somewhat kind sort extent short "
    "once when will soon still before earlier previously formerly progress ongoing underway need needs let technically "
    "maybe perhaps possibly possible probably probable likely might may could would should apparently too tell depends "
    "hard difficult confidence percent hidden blocked dark please help assist understand understood"
)
_STEMS_AGAINST_YES = (
    "incorrect", "inaccura", "disagree", "fail", "lack", "remain", "refus", "declin", "partial", "theor", "hypothet",
    "suppos", "alleg", "guess", "assum", "presum", "doubt", "question", "debat", "ambig", "obscur", "occlu", "blur",
    "provid", "upload", "contradict", "oppos",
)  # fmt: skip
_PHRASES_AGAINST_YES = re.compile(
    r"\b(?:(?:about|going|used) to|so far|far from|\d+ (?:out )?of|more or less|in a (?:moment|minute|second|bit|while)"
    r"|out of (?:the )?(?:view|frame|sight|focus|picture|image|photo(?:graph)?)|i (?:think|believe|suspect|hope|reckon)"
    r"|(?:they|people|some|others) (?:say|claim|think)|(?:second|other|previous|next|last) (?:picture|image|photo)"
    r")\b|\w'll\b"
    r"|^[*_`\"']*\s+(?:is|was|or|and|means?|as|in|can)\b"  # "Yes is what I say if"
)
# What takes a no back besides: a yes, a "no" that belongs to the next word, or a thing done without a "not" beside it.
_AGAINST_NO = _words("yes yeah yep yup aye oui affirmative already problem problems issue issues objection")
_STEMS_AGAINST_NO = ("doubt", "worr")
_PHRASES_AGAINST_NO = re.compile(r"^\.?\s*\d|\bnothing (?:is |was |else is )?(?:missing|wrong|left|remain)")
_JOINED = re.compile(r"[*_`\"']*\s+[^\W_]")
_CLAUSE = re.compile(r"[.,;:!\n\u2013\u2014]|\s--?\s|\b(?:but|and|so|because|since|as|however|while)\b")
_DONE = _words(
    "complete completed completely done finished met satisfied fulfilled achieved accomplished success successful "
    "successfully true correct correctly right confirmed"
)
_UNDONE = _words("incomplete unfinished undone unmet unsatisfied unfulfilled missing wrong false untrue")
_PENDING = _words("far before until remains yet still")


def parse_yes_no(text: str) -> bool | None:
    """Whether an answer is a yes or a no; None: neither, or not surely.

    An answer counts if it begins with the plain word, and the rest is empty ("Yes.", "**no**") or does not withdraw it
    ("YES, the task is complete"). Thinking before it is skipped. Second thoughts, doubt, a restriction or the other
    answer withdraw it. The rule is strict, since a false yes ends an unfinished task: a "not" anywhere withdraws a yes.
    """
    said = spoken(text)
    found = _BEGINNING.match(said) if len(said) <= LONGEST and _READABLE.fullmatch(said) else None
    if found is None:
        return None
    yes, rest = found[1].lower() == "yes", found[2].replace("\u2019", "'").lower()
    if _ALONE.fullmatch(rest):
        return yes
    if (
        not _SET_OFF.match(rest)
        or not _WORD.search(rest)
        or _TURNING.search(rest)
        or _has(rest, _TURNS, _TURNING_STEMS)
    ):
        return None
    return (True if _is_kept_yes(rest) else None) if yes else (False if _is_kept_no(rest) else None)


# How models decline, at the beginning of an answer; who cannot tell has looked.
_DECLINES = re.compile(
    r"\W*(?:unfortunately\W+)?(?:(?:i(?:'m| am) (?:very |so |truly )?)?sorry\b|(?:my )?apologies\b|i apologi[sz]e\b"
    r"|i(?:'m| am) (?:afraid|unable|not able)\b|i (?:cannot|can't|can not|won't|will not|must decline|decline|refuse)\b"
    r"|as an? (?:ai|(?:large )?language model)\b.{0,60}(?:cannot|can't|unable|not able)"
    r"|(?:this|the|your) (?:request|image|picture|photo|photograph|content|question)\b.{0,60}"
    r"(?:violat|not allowed|against|polic|guideline))",
    re.IGNORECASE,
)
_UNSURE = re.compile(r"\b(?:tell|determine|say|sure|certain|confirm|verify|judge|decide|identify)\b", re.IGNORECASE)


def is_refusal(text: str) -> bool:
    """Whether an answer without yes or no declines altogether, such as "I'm sorry, I can't help with that"."""
    text = text[:LONGEST].replace("\u2019", "'")
    return _DECLINES.match(text) is not None and _UNSURE.search(text) is None


def _is_kept_yes(rest: str) -> bool:
    """Whether nothing behind a yes takes it back."""
    rest = _SURE.sub(" ", rest)
    against = _has(rest, _AGAINST_YES, _STEMS_AGAINST_YES) or _PHRASES_AGAINST_YES.search(rest)
    return not against and not _negates(rest)


def _is_kept_no(rest: str) -> bool:
    """Whether nothing behind a no takes it back."""
    if _has(rest, _AGAINST_NO, _STEMS_AGAINST_NO) or _PHRASES_AGAINST_NO.search(rest):
        return False
    clauses = _CLAUSE.split(rest)
    if _JOINED.match(rest) and not _negates(clauses[0]):  # "no wonder"
        return False
    for clause in clauses:
        if _has(clause, _DONE) and not (_negates(clause) or _has(clause, _PENDING)):
            return False
        if _has(clause, _UNDONE) and _negates(clause):
            return False
    return True


def _negates(text: str) -> bool:
    return any(word in _NOT or word.endswith("n't") for word in _WORD.findall(text))


def _has(text: str, words: frozenset[str], stems: tuple[str, ...] = ()) -> bool:
    return any(word in words or word.startswith(stems) for word in _WORD.findall(text))
