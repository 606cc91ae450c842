"""Makes the language models that a run chooses, with its exchanges and its budgets around them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from mpvi_bt.executive.language.budget import Budget, BudgetedModel
from mpvi_bt.executive.language.chat import ChatModel
from mpvi_bt.executive.language.endpoint import EXPOSED, find_endpoint, split_address
from mpvi_bt.executive.language.exchanges import KeptModel, check_folder
from mpvi_bt.executive.language.local import SMOLLM2
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.backends import choose
from mpvi_bt.runs.choices.config import EpisodeConfig

KINDS = ("planner", "checker")  # of backends that may be language models
NAMES = ("openai", "local")  # of the backends, whichever kind they are of


class Models:
    """The language models of one episode. They share its budget.

    Args:
        config: Of the episode.

    Attributes:
        budget: Of the episode, and what it has spent.
    """

    def __init__(self, config: EpisodeConfig) -> None:
        self.budget = Budget("episode", config.calls, config.tokens)
        self._config = config
        suite = config.suite_budget
        self._budgets = [self.budget]
        if suite is not None:
            self._budgets.append(Budget("suite", suite.calls, suite.tokens, suite.ledger))

    def make(self, given: str, tell: Callable[[str], None] = lambda line: None) -> ChatModel:
        """The model of a choice such as "openai:MODEL@URL" or "local". It is not asked yet, nor started.

        Offline nobody is ever asked: neither a key nor the SDK is needed.

        Args:
            given: The choice.
            tell: Is told in a line what takes its time.

        Raises:
            UserError: There is no such address or folder.
            ModelError: The SDK is not installed, or there is no key where one is needed.
        """
        name, _, address = given.partition(":")
        local = name == "local"
        model, url = (Path(address or SMOLLM2).stem, "") if local else split_address(address)
        config = self._config
        if config.offline and config.exchanges is None:
            raise UserError(
                "--offline answers from the exchanges of an earlier run: say where they are, --exchanges DIR."
            )
        if config.exchanges is not None:
            check_folder(config.exchanges, config.offline)
        inner: ChatModel | None = None
        if not config.offline:
            inner = BudgetedModel(_local(given, address, tell) if local else _openai(model, url), self._budgets)
        if config.exchanges is None:
            assert inner is not None
            return inner
        return KeptModel(given, model, config.exchanges, inner)


def _openai(model: str, url: str) -> ChatModel:
    from mpvi_bt.executive.language.openai import OpenAIModel

    return OpenAIModel(model, url)


def _local(given: str, file: str, tell: Callable[[str], None]) -> ChatModel:
    from mpvi_bt.executive.language.local import LocalModel

    return LocalModel(given, Path(file) if file else None, tell)


def check_language_choice(config: EpisodeConfig) -> None:
    """Refuse language models that cannot be asked. Raises as `Models.make`."""
    for kind in KINDS:
        choice = choose(kind, config.backends[kind])
        if choice.name in NAMES:
            Models(config).make(choice.given)


def language_doubts(configs: Iterable[EpisodeConfig]) -> list[str]:
    """A warning for each endpoint whose traffic others can read. Raises as `find_endpoint`."""
    asked = (choose(kind, config.backends[kind]) for config in configs if not config.offline for kind in KINDS)
    addresses = dict.fromkeys(choice.address for choice in asked if choice.name == "openai")
    endpoints = [find_endpoint(split_address(address)[1]) for address in addresses]
    return list(dict.fromkeys(f"{endpoint.url}: {EXPOSED}" for endpoint in endpoints if endpoint.exposed))
