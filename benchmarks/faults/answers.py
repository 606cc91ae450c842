"""`python -m benchmarks.faults.answers`: answers of language models, well formed and not, right and wrong.

A planner's, a checker's, and the bodies that servers send. Who draws an answer knows what it means; it is refused, or
read as that.
"""

from __future__ import annotations

import functools
import json
import random
from pathlib import Path
from typing import Any

import click

from benchmarks.faults.mutations import TEXT, spoiled
from benchmarks.faults.plan_answers import drawn_answer, read
from benchmarks.faults.trials import Outcome, drawn, judged, one_line, options, play
from benchmarks.faults.verdict_answers import CRITERIA, Meaning, drawn_verdict
from mpvi_bt.executive.completion.judge import LanguageChecker
from mpvi_bt.executive.language.response import read_answer
from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.testing import KinematicRobot


def of_planner(draw: random.Random) -> Outcome:
    """An answer to the question for a plan."""
    task, said = drawn_answer(draw)
    wrong: list[str] = []

    def act() -> str | None:
        complaint, misread = read(task, said)
        wrong.append(misread)
        return complaint

    outcome = judged(f"planner: {said.kind}", act)
    return Outcome(outcome.of, "misread", f"{wrong[0]}: {one_line(said.text)}") if any(wrong) else outcome


@functools.cache
def _picture() -> Any:
    return KinematicRobot().look("head")


def of_checker(draw: random.Random) -> Outcome:
    """An answer to the question whether a criterion is met."""
    kind, text, meaning = drawn_verdict(draw)
    criterion = draw.choice(CRITERIA)
    found: list[Judgement] = []

    def act() -> str | None:
        found.append(LanguageChecker(ScriptedChatModel([text])).check(criterion, _picture()))
        return found[0].reason if found[0].fault else None

    outcome = judged(f"checker: {kind}", act)
    wrong = verdict_misread(found[0], meaning) if found else ""
    return Outcome(outcome.of, "misread", f"{wrong}: {one_line(text)}") if wrong else outcome


def verdict_misread(found: Judgement, meaning: Meaning) -> str:
    """What is wrong with how an answer was read; "" if nothing is: what is not sure is refused, or no yes at least."""
    if found.complete:
        return "" if meaning == "yes" else f"read as yes, though it is {meaning}"
    return f"read as no, though it is {meaning}" if not found.fault and meaning != "no" else ""


_BODY = {
    "id": "1",
    "object": "chat.completion",
    "model": "m",
    "choices": [{"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": "yes"}}],
    "usage": {"prompt_tokens": 10, "completion_tokens": 4},
}
_ERRORS: list[Any] = [
    {"error": {"message": "no such model", "code": 404}}, {"error": "busy"}, {"detail": "no"}, {"choices": []}, [],
    "x", None,
    {"error": {"message": {"a": 1}}}, {"error": {"metadata": {"raw": '{"error": {"message": "gone"}}'}}},
    {"message": "?"},
]  # fmt: skip


def of_server(draw: random.Random) -> Outcome:
    """The body of a response of a server of language models."""
    kind = draw.choice(["spoiled", "spoiled", "bytes", "an error"])
    if kind == "spoiled":
        what, data = spoiled(_BODY, draw)
        kind, text = what, json.dumps(data)
    elif kind == "bytes":
        kind, broken = draw.choice(TEXT)(json.dumps(_BODY, indent=1).encode(), draw)
        text = broken.decode("utf-8", "replace")
    else:
        text = json.dumps(spoiled(draw.choice(_ERRORS), draw)[1])
    heard: list[str] = []

    def act() -> str | None:
        said = read_answer(text, "http://gpu:8000/v1", lambda words: words)
        if isinstance(said, ModelError):
            return str(said)
        heard.append(said.text)
        return None

    outcome = judged(f"server: {kind}", act)
    if heard and not _said(text, heard[0]):
        return Outcome(outcome.of, "misread", f"{one_line(heard[0])!r} was read in {one_line(text)}")
    return outcome


def _said(text: str, heard: str) -> bool:
    """Whether the first choice of a whole answer says this."""
    try:
        choice = json.loads(text)["choices"][0]
        content = choice["message"]["content"]
    except (ValueError, LookupError, TypeError):
        return False
    parts = content if isinstance(content, list) else [{"text": content}]
    return "".join(part["text"] for part in parts if isinstance(part, dict) and "text" in part).strip() == heard.strip()


def trial(seed: int, number: int) -> Outcome:
    """One answer."""
    draw = drawn(seed, number)
    return draw.choice([of_planner, of_planner, of_planner, of_checker, of_checker, of_server])(draw)


@click.command()
@options(10_000, "answers")
def main(seed: int, count: int, out: Path, only: int | None) -> None:
    """Let planner, checker and client read answers, and say what came of it."""
    play(functools.partial(trial, seed), seed, count, out, only, "answers")


if __name__ == "__main__":
    main()
