"""Makes the completion checker of a run and its triggers. Each is imported only when it is made."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from mpvi_bt.executive.completion.mistakes import CheckErrors, MistakenChecker
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.protocols import Checker, Triggers
from mpvi_bt.ground.robot.protocol import Robot
from mpvi_bt.runs.choices.backends import choose
from mpvi_bt.runs.choices.config import EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.executive.remote.remote_world import RemoteWorld
    from mpvi_bt.house.sim.world import SimWorld
    from mpvi_bt.runs.choices.language_models import Models

Vocabulary = Mapping[str, Iterable[str]]  # label of a thing to what people call it
_MOST_STEPS = 10**6


def make_checker(
    given: str, world: SimWorld | RemoteWorld, vocabulary: Vocabulary, seed: int, models: Models, detector: str = ""
) -> Checker:
    """The checker of a name.

    Args:
        given: Such as "visual", "visual:fp=0.05,fn=0.1" or "openai:MODEL".
        world: The robot's; only privileged checkers look at it.
        vocabulary: What the labels of pictures, which are the names of things, stand for.
        seed: Of the mistakes that it is to make.
        models: Of the episode.
        detector: That is chosen beside it: two that are learned see by the same weights.

    Raises:
        UnknownName: There is none of that name.
        UserError: Its address is wrong.
        ModelError: The language model cannot be asked.
    """
    choice = choose("checker", given)
    checker: Checker = choice.make(world=world, vocabulary=vocabulary, seed=seed, models=models, detector=detector)
    if choice.backend.errs and choice.address:
        return MistakenChecker(checker, CheckErrors.read(choice.address, f"checker {choice.name}"), world, seed)
    return checker


def make_triggers(given: str, robot: Robot) -> Triggers:
    """The triggers of a name, such as "proprioceptive" or "periodic:300". Raises UserError as `make_checker`."""
    made: Triggers = choose("trigger", given).make(robot=robot)
    return made


def check_checker_choice(config: EpisodeConfig) -> None:
    """Refuse a choice of checker or triggers that cannot be made. Raises UserError."""
    doubt(config)
    trigger = choose("trigger", config.trigger)
    if trigger.name == "periodic":
        _steps(trigger.address)
    checker = choose("checker", config.checker)
    if checker.part is None and checker.name == "learned":
        from mpvi_bt.runs.choices.learned_eyes import eyes_by, weights_of

        eyes_by(weights_of(config.detector))


def doubt(config: EpisodeConfig) -> str:
    """One line for a person if the checker is to err, or "". Raises UserError if its errors are none."""
    choice = choose("checker", config.checker)
    if not (choice.backend.errs and choice.address):
        return ""
    name = f"checker {choice.name}"
    return f"{name} {CheckErrors.read(choice.address, name)}"


def visual(world: SimWorld | RemoteWorld, vocabulary: Vocabulary) -> Checker:
    """By what one picture shows."""
    from mpvi_bt.finding.perception.visual_checker import VisualChecker

    return VisualChecker(vocabulary, robot=world.robot.model)


def learned(world: SimWorld | RemoteWorld, vocabulary: Vocabulary, detector: str) -> Checker:
    """By what a network sees in one picture. Of the vocabulary it takes what floors are called."""
    from mpvi_bt.finding.perception.learned_checker import LearnedChecker
    from mpvi_bt.finding.perception.segments import FLOOR, kind_of
    from mpvi_bt.runs.choices.learned_eyes import eyes_by, weights_of

    floors = [phrase for label, called in vocabulary.items() if kind_of(label) == FLOOR for phrase in called]
    return LearnedChecker(eyes_by(weights_of(detector) if detector else ""), floors, robot=world.robot.model)


def oracle(world: SimWorld | RemoteWorld, vocabulary: Vocabulary) -> Checker:
    """By the simulator's state. Raises UserError where there is no simulator."""
    from mpvi_bt.executive.completion.oracle import OracleChecker
    from mpvi_bt.house.sim.world import SimWorld
    from mpvi_bt.runs.choices.world_truth import TrueState

    if not isinstance(world, SimWorld):
        raise UserError("checker oracle reads the simulator itself, and there is none here.")
    return OracleChecker(TrueState(world), vocabulary)


def openai(given: str, models: Models) -> Checker:
    """By a language model that sees."""
    from mpvi_bt.executive.completion.judge import LanguageChecker

    return LanguageChecker(models.make(given))


def proprioceptive(robot: Robot) -> Triggers:
    """When a hand or an arm has ended something."""
    from mpvi_bt.executive.completion.triggers import ProprioceptiveTriggers

    return ProprioceptiveTriggers(robot)


def periodic(address: str) -> Triggers:
    """Every so many steps."""
    from mpvi_bt.executive.completion.periodic import PeriodicTriggers

    return PeriodicTriggers(_steps(address))


def _steps(address: str) -> int:
    """The period of an address [steps]. Raises UserError if it is none."""
    if not (address.isascii() and address.isdecimal() and 0 < int(address[:10]) <= _MOST_STEPS):
        whole = f"a whole number of steps from 1 to {_MOST_STEPS}"
        raise UserError(f"trigger periodic: {whole}, such as periodic:300, not {shown(address)}.")
    return int(address)
