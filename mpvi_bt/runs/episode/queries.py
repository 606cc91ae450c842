"""Statistics of an episode's questions to the completion checker: number, errors, cost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.ground.marked_yaml import Amount, Count, Record

if TYPE_CHECKING:
    from mpvi_bt.executive.behaviors.context import Query
    from mpvi_bt.executive.tree.spec import TreeSpec


class Queries(Record):
    """The questions of one episode.

    Attributes:
        units: How many parts of the tree end when the checker says so: the paper's terminal subtasks.
        asked, yes: Questions, and those answered by yes.
        false_yes, false_no: Answers that were wrong when they came, by the simulator's state; read afterwards, for the
            count alone. A false yes ends a unit that is not done.
        unknown: Answers of which the simulator does not know whether they were right.
        malformed: Answers of a language model that were neither yes nor no. The unit goes on as after a no, but they
            are none.
        refused: Questions that a language model refused to answer, likewise.
        errors: Questions that got no answer for another reason, likewise.
        latency_s: Sum of the times that answers took.
        tokens_in, tokens_out: Of language models, those of answers on file too.
        kept: Answers that were on file.
        last_fault: What was said of the last question that got no yes or no; "" where every one got it.
    """

    units: Count = 0
    asked: Count = 0
    yes: Count = 0
    false_yes: Count = 0
    false_no: Count = 0
    unknown: Count = 0
    malformed: Count = 0
    refused: Count = 0
    errors: Count = 0
    latency_s: Amount = 0.0
    tokens_in: Count = 0
    tokens_out: Count = 0
    kept: Count = 0
    last_fault: str = ""


def count_queries(queries: Sequence[Query], truths: Sequence[bool | None], tree: TreeSpec) -> Queries:
    """Count an episode's questions.

    Args:
        queries: In order.
        truths: Of each, whether its criterion was so when the answer came; None: not known. May be shorter.
        tree: That was run.
    """
    faults = Counter(query.fault for query in queries if query.fault)
    known = [*truths, *[None] * len(queries)]
    judged = [(query.complete, truth) for query, truth in zip(queries, known, strict=False) if not query.fault]
    costs = [query.cost for query in queries if query.cost is not None]
    return Queries(
        units=sum(placed.spec.kind == "check_complete" for placed in tree.nodes),
        asked=len(queries),
        yes=sum(query.complete for query in queries),
        false_yes=judged.count((True, False)),
        false_no=judged.count((False, True)),
        unknown=sum(truth is None for _, truth in judged),
        malformed=faults["bad_answer"],
        refused=faults["refused"],
        errors=faults.total() - faults["bad_answer"] - faults["refused"],
        latency_s=round(sum(query.latency_s for query in queries), 6),
        tokens_in=sum(cost.tokens_in for cost in costs),
        tokens_out=sum(cost.tokens_out for cost in costs),
        kept=sum(cost.kept for cost in costs),
        last_fault=next((query.reason for query in reversed(queries) if query.fault), ""),
    )


def with_truth(
    handoffs: Iterable[Handoff], queries: Sequence[Query], truths: Sequence[bool | None]
) -> Iterator[Handoff]:
    """Handoffs with how many of the checker's noes were wrong, where any of its answers can be judged.

    Args:
        handoffs: To the policy.
        queries, truths: As of `count_queries`.
    """
    judged = [(query, so) for query, so in zip(queries, truths, strict=False) if so is not None]
    for handoff in handoffs:
        beside = handoff.path.rpartition("/")[0] + "/"
        asked = [
            (query.complete, so)
            for query, so in judged
            if query.path.startswith(beside) and handoff.began_s <= query.time_s <= handoff.ended_s and not query.fault
        ]
        yield replace(handoff, false_noes=asked.count((False, True))) if asked else handoff


def queries_text(counted: Iterable[Queries]) -> str:
    """The questions of episodes as one line for a person; "" if there was none."""
    total: Counter[str] = Counter()
    last_fault = ""
    for queries in counted:
        total.update(queries.model_dump(exclude={"last_fault"}))
        last_fault = queries.last_fault or last_fault
    if not total["asked"]:
        return ""
    faults = {"malformed": "neither yes nor no", "refused": "refused", "errors": "without an answer"}
    no = total["asked"] - total["yes"] - sum(total[key] for key in faults)
    parts = [
        f"{total['asked']} asked in {total['units']} unit{'s' * (total['units'] != 1)}",
        f"{total['yes']} yes" + (f" ({total['false_yes']} false)" if total["false_yes"] else ""),
        f"{no} no" + (f" ({total['false_no']} false)" if total["false_no"] else ""),
    ]
    parts += [f"{total[key]} {said}" for key, said in faults.items() if total[key]]
    parts += [f"{total['latency_s']:.1f} s waited for"] if total["latency_s"] else []
    if tokens := total["tokens_in"] + total["tokens_out"]:
        parts.append(f"{tokens} tokens" + (f", {total['kept']} answers from file" if total["kept"] else ""))
    return ", ".join(parts) + (f". The last one without a plain answer: {last_fault}" if last_fault else "")
