"""Skills (manipulation primitives) from files: phrases, criterion, needs, effects, triggers, timeout, motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from mpvi_bt.executive.plan.pattern import Pattern, Slot, pattern
from mpvi_bt.executive.plan.schema import Phrase
from mpvi_bt.executive.plan.skill_effects import SkillEffects, SkillNeeds
from mpvi_bt.executive.plan.skill_phrases import checked_phrase, checked_template, filled, first_words, slots
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.import_paths import IMPORT_PATH
from mpvi_bt.ground.marked_yaml import Record, SourceMarks, load_marked, validate_data

Named = TypeVar("Named", SkillNeeds, SkillEffects, tuple[Slot, ...])


class Trigger(Record):
    """The proprioceptive event at the end of a primitive, and the camera that then sees the result.

    Attributes:
        event: A hand has taken hold ("grasp") or has let go ("release"), what it holds has been moved and stands
            ("stop"), the arms have moved and come to rest ("rest"), the base has driven and come to rest ("arrival"),
            or the whole body stands still and does no more ("idle").
        camera: "head"; "hand": the wrist camera of the hand that it happened to (Paper, Manipulation: the trigger
            directs the query to that wrist's view); "other_hand": that of the other one, which now holds the thing.
        witness: "hand": after a no, the checker also gets what that wrist's camera saw when the hand had just let go. A
            container's wall may hide from the head what has fallen in (our choice).
            Of a "release" only.
        refractory_s: Least simulated time between this event and the one before; None: as all others.
    """

    event: Literal["grasp", "release", "stop", "rest", "arrival", "idle"]
    camera: Literal["head", "hand", "other_hand"]
    witness: Literal["hand"] | None = None
    refractory_s: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] | None = None

    @field_validator("witness")
    @classmethod
    def _is_of_a_release(cls, witness: str | None, info: ValidationInfo) -> str | None:
        """Raises ValueError for another event: only a release has such a picture."""
        if witness is not None and info.data.get("event") not in (None, "release"):
            raise ValueError(f"only a release has a witness, not the event {info.data['event']!r}")
        return witness


class Skill(Record):
    """A manipulation primitive (Paper, Subtask Planning appendix: a primitive with a pre-defined completion heuristic).

    Attributes:
        name: Such as "place_in".
        about: One line for a person.
        phrases: What names it in a plan.
        hands: How many hands it takes; 0: it only drives, for policies that are handed navigation segments. Planners
            are not told of it: a plan says itself what is navigation.
        shows: What the judge should see at the end, as a criterion with slots; `SkillCall.criterion` fills it in.
        triggers: Events that ask the completion checker.
        timeout_s: Simulated time that it may take.
        needs: Conditions before the skill.
        effects: Conditions after the skill.
        unseen: Slots of things that need not be seen before, such as the contents of a vessel.
        like: Another skill, whose motion does this one too; its slots are that one's, and so are needs, effects and
            unseen where the file says nothing of them. None: it has a motion of its own.
        motion: That motion, where it is not one of ours: the import path of a function, "my_module:turn_knob", which
            the scripted policies call as they call those of `mpvi_bt.hands.policies.repertoire`.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    about: Phrase
    phrases: tuple[Annotated[Phrase, AfterValidator(checked_phrase)], ...] = Field(min_length=1)
    hands: Literal[0, 1, 2] = 1
    shows: Annotated[Phrase, AfterValidator(checked_template)] | None = None
    triggers: tuple[Trigger, ...] = Field(min_length=1)
    timeout_s: float = Field(gt=0, le=86_400, allow_inf_nan=False, strict=True)
    needs: SkillNeeds = SkillNeeds()
    effects: SkillEffects = SkillEffects()
    unseen: tuple[Slot, ...] = ()
    like: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] | None = None
    motion: Annotated[str, Field(pattern=rf"^{IMPORT_PATH.pattern}$")] | None = None

    @field_validator("motion")
    @classmethod
    def _is_the_only_one(cls, motion: str | None, info: ValidationInfo) -> str | None:
        """Raises ValueError beside `like`: one of them would do nothing."""
        if motion is not None and info.data.get("like") is not None:
            raise ValueError(f"the skill is done like {info.data['like']!r} already; leave one of the two out")
        return motion

    @field_validator("shows")
    @classmethod
    def _is_said(cls, shows: str | None, info: ValidationInfo) -> str | None:
        """Raises ValueError for a slot without words in any phrase: the judge would get no value for it."""
        _check_slots(slots(shows or ""), info)
        return shows

    @field_validator("needs", "effects", "unseen")
    @classmethod
    def _is_named(cls, told: Named, info: ValidationInfo) -> Named:
        """Raises ValueError for a slot that no phrase has words for."""
        _check_slots(told if isinstance(told, tuple) else told.slots, info)
        return told

    @field_validator("effects")
    @classmethod
    def _follows(cls, effects: SkillEffects, info: ValidationInfo) -> SkillEffects:
        """Raises ValueError for effects that the needs contradict, if the file tells both."""
        needs = info.data.get("needs")
        if needs is not None and needs.model_fields_set and (why := effects.contradiction(needs)):
            raise ValueError(why)
        return effects

    @cached_property
    def patterns(self) -> tuple[Pattern, ...]:
        """Its phrases, read."""
        return tuple(map(pattern, self.phrases))

    @cached_property
    def verbs(self) -> frozenset[str]:
        """The words that its phrases begin with, in lower case."""
        return frozenset(verb for phrase in self.phrases for verb in first_words(phrase))


@dataclass(frozen=True)
class SkillCall:
    """A skill and the words that fill its slots, such as {"object": "can of soda", "hand": "right"}."""

    skill: Skill
    arguments: Mapping[str, str]

    @property
    def motion(self) -> str:
        """The skill with the motion: itself, or the skill that it is `like`."""
        return self.skill.like or self.skill.name

    @property
    def in_hand(self) -> Slot | None:
        """The slot of what has to be in a hand before; None: nothing has to be."""
        return next((slot for slot in self.skill.needs.held if slot in self.arguments), None)

    @property
    def target(self) -> str | None:
        """The target of the hand: the thing to take, or the place to put it; None: unknown."""
        return self.arguments.get(self.skill.effects.target or "")

    @property
    def criterion(self) -> str | None:
        """The state that it should end in, such as "the cup is in the sink"; None if its words do not say."""
        return filled(self.skill.shows, self.arguments) if self.skill.shows else None


def load_skill(path: str | Path) -> Skill:
    """A skill from its file, which bears its name.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return check_skill(*load_marked(path))


def check_skill(data: object, marks: SourceMarks) -> Skill:
    """As `load_skill`, of data that is already loaded."""
    expect("skill", data, marks)
    skill = validate_data(data, marks, Skill)
    named = Path(marks.file).suffix  # what comes through a pipe has no file's name
    if named and skill.name != (stem := Path(marks.file).stem):
        message = f"skill {skill.name!r} in a file named {stem!r}; they must agree"
        raise FileProblems([marks.problem(("name",), "name", message)])
    return skill


def load_skills(folders: Iterable[str | Path] | None = None) -> dict[str, Skill]:
    """Skills by name, from every YAML and JSON file of the folders, the first folder's winning.

    Needs, effects and unseen slots that a file says nothing of are those of the skill that it is like, or else those of
    ours of that name.

    Args:
        folders: By default `skills/` of every root (`mpvi_bt.ground.paths.roots`).

    Raises:
        FileProblems: Everything that is wrong with the files.
    """
    found = paths.files("skills") if folders is None else [p for f in folders for p in paths.files_in(Path(f))]
    files: dict[str, list[Path]] = {}
    for path in found:
        files.setdefault(path.stem, []).append(path)
    skills = {name: _read(first, _stamp(first)) for name, (first, *_) in files.items()}
    for name, (_, *hidden) in files.items():
        for path in hidden:
            if path.parent == paths.shipped() / "skills":
                skills[name] = _completed(skills[name], _read(path, _stamp(path)))
    return {name: _completed(skill, skills.get(skill.like or name, skill)) for name, skill in skills.items()}


def _completed(skill: Skill, model: Skill) -> Skill:
    """The skill with the needs, effects and unseen slots of another one where it says nothing of them."""
    unsaid = {"needs", "effects", "unseen"} - skill.model_fields_set
    said = {field: getattr(model, field) for field in unsaid & model.model_fields_set}
    return skill.model_copy(update=said) if said else skill


def _check_slots(named: Iterable[str], info: ValidationInfo) -> None:
    """Raises ValueError for a slot that no phrase of the skill gives."""
    given = [slot for phrase in info.data.get("phrases", ()) for slot in pattern(phrase).slots]
    for slot in named if given else ():
        if slot not in given:
            raise ValueError(f"no phrase gives {slot!r}; they give: {', '.join(dict.fromkeys(given))}")


@cache
def shipped_skills() -> tuple[str, ...]:
    """Names of the skills that ship, sorted. Scripted policies know a motion for each of them."""
    return tuple(sorted(path.stem for path in paths.files_in(paths.shipped() / "skills")))


def _stamp(path: Path) -> object:
    """What changes when the file does."""
    try:
        stat = path.stat()
    except OSError:
        return None  # `load_skill` says why
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


@lru_cache(maxsize=1024)
def _read(path: Path, stamp: object) -> Skill:
    """A skill, read once while its file has that stamp: whoever checks file after file asks for all each time."""
    return load_skill(path)
