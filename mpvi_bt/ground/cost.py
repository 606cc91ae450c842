"""What a language model's answer cost, as checkers and planners tell it and traces keep it."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.ground.marked_yaml import Count


@dataclass(frozen=True)
class Cost:
    """Cost of a language model's answer.

    Attributes:
        model: That gave it.
        tokens_in, tokens_out: Of the question and of the answer, as the model's server counts them.
        kept: It came from answers on file: nothing was spent.
    """

    model: str
    tokens_in: Count = 0
    tokens_out: Count = 0
    kept: bool = False
