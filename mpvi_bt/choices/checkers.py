"""Makes the checker that a run chooses, and the triggers that have it asked. Each is imported only when it is made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from mpvi_bt.choices.backends import choose, split
from mpvi_bt.choices.config import EpisodeConfig
from mpvi_bt.choices.plugins import find
from mpvi_bt.completion.mistakes import CheckErrors, MistakenChecker
from mpvi_bt.errors import UserError, shown
from mpvi_bt.protocols import Checker, Triggers
from mpvi_bt.robot.protocol import Robot

if TYPE_CHECKING:
    from mpvi_bt.choices.language_models import Models
    from mpvi_bt.remote.remote_world import RemoteWorld
    from mpvi_bt.sim.world import World

Vocabulary = Mapping[str, Iterable[str]]  # label of a thing to what people call it
_MOST_STEPS = 10**6


def make_checker(given: str, world: World | RemoteWorld, vocabulary: Vocabulary, seed: int, models: Models) -> Checker:
    """The checker of a name.

    Args:
        given: Such as "visual", "visual:fp=0.05,fn=0.1" or "openai:MODEL".
        world: The robot's; only privileged checkers look at it.
        vocabulary: What the labels of pictures, which are the names of things, stand for.
        seed: Of the mistakes that it is to make.
        models: Of the episode.

    Raises:
        UnknownName: There is none of that name.
        UserError: Its address is wrong.
        ModelError: The language model cannot be asked.
    """
    choose("checker", given)
    name, address = split(given)
    if name == "openai":
        from mpvi_bt.completion.judge import LanguageChecker

        return LanguageChecker(models.make(given))
    if name not in _MAKERS and (part := find("checker", given)) is not None:
        made: Checker = part.make(vocabulary=vocabulary, seed=seed)
        return made
    checker = _MAKERS[name](world, vocabulary)
    return MistakenChecker(checker, CheckErrors.read(address, name), world, seed) if address else checker


def make_triggers(given: str, robot: Robot) -> Triggers:
    """The triggers of a name, such as "proprioceptive" or "periodic:300". Raises UserError as `make_checker`."""
    if (part := find("trigger", given)) is not None:
        made: Triggers = part.make(robot=robot)
        return made
    if steps := _period(given):
        from mpvi_bt.completion.periodic import PeriodicTriggers

        return PeriodicTriggers(steps)
    from mpvi_bt.completion.triggers import ProprioceptiveTriggers

    return ProprioceptiveTriggers(robot)


def check_checker_choice(config: EpisodeConfig) -> None:
    """Refuse a choice of checker or triggers that cannot be made. Raises UserError."""
    doubt(config)
    _period(config.trigger)


def doubt(config: EpisodeConfig) -> str:
    """One line for a person if the checker is to err, or "". Raises UserError if its errors are none."""
    choose("checker", config.checker)
    name, address = split(config.checker)
    return f"checker {name} {CheckErrors.read(address, name)}" if address and name in _MAKERS else ""


def _period(given: str) -> int:
    """Steps of polling, 0 of triggers that do not poll."""
    choose("trigger", given)
    name, address = split(given)
    if name != "periodic":
        return 0
    if not (address.isascii() and address.isdecimal() and 0 < int(address[:10]) <= _MOST_STEPS):
        whole = f"a whole number of steps from 1 to {_MOST_STEPS}"
        raise UserError(f"trigger periodic: {whole}, such as periodic:300, not {shown(address)}.")
    return int(address)


def _visual(world: World | RemoteWorld, vocabulary: Vocabulary) -> Checker:
    from mpvi_bt.completion.visual import VisualChecker

    return VisualChecker(vocabulary, robot=world.robot.model)


def _oracle(world: World | RemoteWorld, vocabulary: Vocabulary) -> Checker:
    from mpvi_bt.choices.world_truth import TrueState
    from mpvi_bt.completion.oracle import OracleChecker
    from mpvi_bt.sim.world import World

    if not isinstance(world, World):
        raise UserError("checker oracle reads the simulator itself, and there is none here.")
    return OracleChecker(TrueState(world), vocabulary)


# Those that are computed here, and may be made to err.
_MAKERS: Mapping[str, Callable[[World | RemoteWorld, Vocabulary], Checker]] = {"visual": _visual, "oracle": _oracle}
