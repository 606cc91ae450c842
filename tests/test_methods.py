"""Methods: names for settings, the trees that they make, and what each leaves alone."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

from mpvi_bt.apps.cli.check import check
from mpvi_bt.apps.cli.listing import list_
from mpvi_bt.apps.cli.setting_options import method, settings
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import _absent
from mpvi_bt.executive.ticking.loop import Watcher, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_instruction, compile_plan
from mpvi_bt.executive.tree.writer import expanded
from mpvi_bt.executive.tree.yaml_io import from_expanded
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.config import METHOD, EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode import assembly, episode
from mpvi_bt.runs.episode.prepare import prepare
from mpvi_bt.runs.episode.saved_episode import SavedSettings
from mpvi_bt.testing import KinematicWorld, scripted_context

METHODS = paths.names("tasks/methods")
GOLDEN = Path(__file__).parent / "golden" / "methods.txt"
TASK = "tidying_bedroom"
PLAN = Plan.model_validate(
    {
        "task_name": "shoes",
        "instruction": "Put the shoe on the rack, for $5.",
        "segments": [
            {
                "type": "navigation",
                "description": "go to the shoe",
                "completion_criterion": "the robot is at the shoe",
                "target": "shoe",
                "room": "corridor",
            },
            {
                "type": "manipulation",
                "description": "pick up the shoe",
                "completion_criterion": "the shoe is held in a gripper",
            },
        ],
    }
)


def config(method: str, **overriding: Any) -> EpisodeConfig:
    """An episode by a method."""
    return replace(EpisodeConfig(TASK, **load_method(method)), **overriding)


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_a_way_to_run_an_episode(name: str) -> None:
    """What a result records of it says its name and every backend, and a saved episode takes it up again."""
    record = config(name).record()
    assert record["method"] == name
    assert {key: record.get(key, "navigator") for key in load_method(name)} == dict(load_method(name))
    assert {"planner", "map", "detector", "policy", "checker", "trigger"} <= load_method(name).keys()
    assert SavedSettings(**record).method == name


def test_the_papers_variants_differ_from_the_method_in_one_thing() -> None:
    """That is what an ablation is (Paper, Ablation Study); the baseline has no plan either."""
    whole = load_method("mpvi")
    changes = {name: dict(load_method(name).items() - whole.items()) for name in METHODS}
    assert {name: {k: v for k, v in changed.items() if k != "method"} for name, changed in changes.items()} == {
        "mpvi": {},
        "e2e": {"planner": "none", "drive": "policy"},
        "subtask_prediction": {"drive": "policy"},
        "oracle_localization": {"detector": "oracle"},
        "no_trigger": {"trigger": "periodic:300"},
        "expert": {"detector": "oracle", "policy": "expert", "checker": "oracle"},
        "noisy_localization": {"detector": "segmentation:miss=0.1,confuse=0.05,jitter=2"},
        "learned_localization": {"detector": "learned"},
        "mpvi_pixels": {"detector": "learned", "checker": "learned"},
    }  # fmt: skip


def test_a_run_without_a_method_says_nothing_of_any() -> None:
    """Results of before stay those of the same configuration."""
    assert not {"method", "drive"} & EpisodeConfig(TASK).record().keys()


def test_trees_of_methods_are_golden() -> None:
    """Planned routes, the policy in their place, and the policy alone."""
    drives = {name: load_method(name).get("drive", "navigator") for name in ("mpvi", "subtask_prediction")}
    trees = {name: compile_plan(PLAN, load_skills(), drive=drive) for name, drive in drives.items()}
    trees["e2e"] = compile_instruction("shoes", PLAN.instruction)
    drawn = "\n".join(f"{name}\n{ascii_tree(tree)}\n" for name, tree in trees.items())
    assert drawn == GOLDEN.read_text(encoding="utf-8")


def test_the_policy_alone_is_told_the_tasks_instruction() -> None:
    """All of it, in one node that never ends by itself."""
    spec = prepare(config("e2e")).spec
    assert [(placed.spec.kind, placed.spec.parameters.prompt) for placed in spec.nodes] == [  # type: ignore[attr-defined]
        ("manipulate", load_task(TASK).instruction)
    ]


def test_traces_of_the_policy_alone_can_be_read() -> None:
    """The tree that a trace begins with has the very nodes that the trace tells of."""
    spec = compile_instruction("shoes", PLAN.instruction)
    again = from_expanded(expanded(spec))
    assert [placed.path for placed in again.nodes] == [placed.path for placed in spec.nodes]
    assert again == spec


def test_a_policy_hears_the_instruction_as_it_is_and_is_never_done() -> None:
    """A dollar sign is a dollar sign, and the tree goes on as long as it is ticked."""
    world, told = KinematicWorld(), []

    class Hears:
        name, cameras = "hears", ()

        def reset(self) -> None: ...

        def infer(self, observation: Mapping[str, Any]) -> Array:
            told.append(observation["prompt"])
            return np.zeros((4, 23))

    context = replace(scripted_context(world, {}, {}, {}), policy=Hears())
    outcome = run_episode(Tree(compile_instruction("shoes", PLAN.instruction)), world, context, max_time_s=2.0)
    assert (outcome.ending, set(told)) == ("time_limit", {PLAN.instruction})


def test_a_plan_means_nothing_to_who_has_none() -> None:
    """What would be left out without a word is refused."""
    for overriding in ({"plan": "picking_up_trash"}, {"tree": TASK}, {"on_failure": "retry:2"}):
        with pytest.raises(UserError, match="planner none"):
            prepare(config("e2e", **overriding))
    with pytest.raises(UserError, match="--drive"):
        prepare(config("subtask_prediction", tree=TASK))


# --------------------------------------------------------------------------------------------------- files


def test_an_unknown_method_is_told_the_nearest() -> None:
    """As any name."""
    with pytest.raises(UnknownName, match="Did you mean 'subtask_prediction'"):
        load_method("subtask_predictions")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("policy: reactive", "policy: reactiv", "unknown backend 'reactiv'. Did you mean 'reactive'"),
        ("trigger: proprioceptive", "trigger: periodic", "say where"),
        ("trigger: proprioceptive", "triger: proprioceptive", "Did you mean 'trigger'"),
        ("map: prior", "map: prior\ndrive: polcy", "Did you mean 'policy'"),
        ("map: prior", "map: prior\non_failure: retri:2", "retry"),
        ("map: prior", "map: prior\npolicy_settings: openpi_cmet", "Did you mean 'openpi_comet'"),
        ("planner: recorded\n", "", "missing key 'planner'"),
    ],
)
def test_what_is_wrong_with_a_method_is_told(old: str, new: str, said: str, tmp_path: Path) -> None:
    """On one line, with its place."""
    path = tmp_path / "mine.yaml"
    path.write_text(paths.find("tasks/methods", "mpvi").read_text().replace(old, new))
    with pytest.raises(FileProblems, match=r"mine.yaml:\d+:\d+: ") as caught:
        load_method(str(path))
    assert said in str(caught.value)
    assert CliRunner().invoke(check, [str(path)], standalone_mode=False).return_value == 1


def test_methods_are_listed() -> None:
    """Each with its line."""
    printed = CliRunner().invoke(list_, ["methods"]).stdout
    assert all(name in printed for name in METHODS)


# ------------------------------------------------------------------------------------------- command line


def chosen(*given: str) -> dict[str, Any]:
    """What a command takes from its options."""

    @click.command()
    @method(*METHOD)
    @settings(*METHOD)
    def command(**given: Any) -> dict[str, Any]:
        return given

    result = CliRunner().invoke(command, given, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    assert isinstance(result.return_value, dict)
    return result.return_value


def test_flags_override_the_method_wherever_they_stand() -> None:
    """And the method's name stays: the settings beside it say what was run."""
    fields = load_method("no_trigger")
    assert chosen("--method", "no_trigger").items() >= fields.items()
    for words in (["--method", "no_trigger", "--policy", "expert"], ["--policy", "expert", "--method", "no_trigger"]):
        assert chosen(*words).items() >= {**fields, "policy": "expert"}.items()


@pytest.mark.parametrize("name", METHODS)
def test_every_method_is_a_mix_of_flags(name: str) -> None:
    """None can do what flags cannot."""
    fields = dict(load_method(name))
    fields.pop("method")
    flags = [word for key, value in fields.items() for word in (f"--{key.replace('_', '-')}", value)]
    assert {**chosen(*flags), "method": name} == chosen("--method", name)


# ------------------------------------------------------------------------------------------------ episodes


class After(Watcher, AbstractContextManager[Any]):
    """Ends an episode after so many ticks."""

    def __init__(self, ticks: int) -> None:
        self.left = ticks

    def step(self, tree: Any, world: Any) -> None:
        """Count."""
        self.left -= 1

    def __enter__(self) -> Any:
        return lambda: self.left <= 0

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None: ...


def run(given: EpisodeConfig, ticks: int) -> dict[str, Any]:
    """The result of an episode's first ticks, with backends that need no picture."""
    after = After(ticks)
    return episode.run(replace(given, policy="expert", detector="oracle", checker="oracle"), [after], stop=after)  # type: ignore[arg-type]


def absent(what: str) -> Any:
    """Makes what raises at the first use."""
    return lambda *args, **kwargs: _absent(what)


@pytest.mark.rare
@pytest.mark.slow
def test_the_policy_alone_asks_neither_planner_nor_navigator_nor_checker(monkeypatch: pytest.MonkeyPatch) -> None:
    """They may break at the first word: the episode goes on, and its result says what method it was."""
    for what in ("navigator", "checker", "triggers"):
        monkeypatch.setattr(assembly, f"make_{what}", absent(what))
    monkeypatch.setattr("mpvi_bt.runs.episode.prepare.make_planner", absent("planner"))
    result = run(config("e2e"), 150)
    assert result["config"]["method"] == "e2e"
    assert result["queries"]["asked"] == 0
    assert result["agent_distance"]["base"] > 0.05


@pytest.mark.rare
@pytest.mark.slow
def test_a_policy_that_drives_is_told_segments_and_asks_no_navigator(monkeypatch: pytest.MonkeyPatch) -> None:
    """The checker is asked whether it is there, at the first rest at the latest."""
    monkeypatch.setattr(assembly, "make_navigator", absent("navigator"))
    result = run(config("subtask_prediction"), 150)
    assert result["config"]["drive"] == "policy"
    assert result["agent_distance"]["base"] > 0.05
