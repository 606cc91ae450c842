"""Budgets of calls and tokens for an episode and for a suite."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mpvi_bt.executive.language.chat import Answer, ChatModel, Message, Schema
from mpvi_bt.ground.errors import ModelError
from mpvi_bt.ground.writing import unwritable, write_whole

_CHARACTERS = 4  # a token, roughly, where a server does not count


@dataclass(frozen=True)
class Spent:
    """What was asked so far.

    Attributes:
        calls: Questions put, whatever came of them; tries of one question are one.
        tokens: Of questions and answers.
    """

    calls: int = 0
    tokens: int = 0


class Budget:
    """Counts what is spent, and says when nothing more may be.

    A question is asked as long as neither limit is reached, so the last answer may go over the limit of tokens.

    Args:
        whose: Such as "episode", for messages.
        calls, tokens: At most; None: any number.
        ledger: File in which it is counted for all processes that share it, and for later ones; None: in memory.
    """

    def __init__(
        self, whose: str, calls: int | None = None, tokens: int | None = None, ledger: Path | None = None
    ) -> None:
        self._whose, self._calls, self._tokens, self._ledger = whose, calls, tokens, ledger
        self._spent = Spent()
        self._lock = threading.Lock()

    @property
    def spent(self) -> Spent:
        """So far."""
        with self._held():
            return self._read()

    def begin(self) -> None:
        """Count a call. Raises ModelError ("over_budget"): there is nothing left for it."""
        with self._held():
            spent = self._read()
            for what, used, most in (("calls", spent.calls, self._calls), ("tokens", spent.tokens, self._tokens)):
                if most is not None and used >= most:
                    told = f"{used} of {most} {what} are used ({spent.calls} calls, {spent.tokens} tokens)"
                    raise ModelError("over_budget", f"the budget of the {self._whose} is spent: {told}.")
            self._write(Spent(spent.calls + 1, spent.tokens))

    def end(self, tokens: int) -> None:
        """Count what a call took."""
        with self._held():
            spent = self._read()
            self._write(Spent(spent.calls, spent.tokens + tokens))

    @contextlib.contextmanager
    def _held(self) -> Iterator[None]:
        """Let nobody else count meanwhile."""
        with self._lock:
            if self._ledger is None:
                yield
                return
            try:
                self._ledger.parent.mkdir(parents=True, exist_ok=True)
                handle = os.open(self._ledger.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o644)
            except OSError as error:
                raise unwritable(self._ledger, error) from None
            try:
                fcntl.flock(handle, fcntl.LOCK_EX)
                yield
            finally:
                os.close(handle)

    def _read(self) -> Spent:
        if self._ledger is None:
            return self._spent
        try:
            if self._ledger.exists() and not self._ledger.is_file():  # a pipe, say, which nobody may ever write to
                raise ValueError
            data = json.loads(self._ledger.read_bytes())
            spent = Spent(data["calls"], data["tokens"])
            if not all(isinstance(count, int) and count >= 0 for count in (spent.calls, spent.tokens)):
                raise ValueError
        except FileNotFoundError:
            return Spent()
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            raise ModelError(
                "over_budget", f"{self._ledger}: cannot be read, so nothing more is spent; delete it to count anew."
            ) from None
        return spent

    def _write(self, spent: Spent) -> None:
        self._spent = spent
        if self._ledger is not None:
            write_whole(self._ledger, json.dumps({"calls": spent.calls, "tokens": spent.tokens}) + "\n")


class BudgetedModel:
    """A model that is asked within budgets.

    Args:
        inner: Who is asked.
        budgets: All must have something left.

    Attributes:
        name: Of the model.
    """

    def __init__(self, inner: ChatModel, budgets: Sequence[Budget]) -> None:
        self.name, self._inner, self._budgets = inner.name, inner, tuple(budgets)

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """As `ChatModel` says. Raises ModelError as the inner one, or "over_budget"."""
        for budget in self._budgets:
            budget.begin()
        tokens = 0
        try:
            answer = self._inner.ask(messages, schema)
            tokens = answer.tokens_in + answer.tokens_out or _estimate(messages, answer.text)
        except ModelError as error:
            tokens = error.tokens
            raise
        finally:
            for budget in self._budgets:
                budget.end(tokens)
        return answer


def _estimate(messages: Sequence[Message], answer: str) -> int:
    """Tokens of texts (Our choice: one in four letters); pictures count nothing, as every model has its own price."""
    return -(-(sum(len(message.text) for message in messages) + len(answer)) // _CHARACTERS)
