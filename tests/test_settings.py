"""The settings of an episode have one home, `EpisodeConfig`; everything that takes them is derived from it."""

from __future__ import annotations

import inspect
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

import mpvi_bt
from mpvi_bt.apps.cli.run import run
from mpvi_bt.apps.cli.setting_options import method
from mpvi_bt.apps.cli.suite import suite
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.robots import ROBOTS
from mpvi_bt.runs.choices.config import ALWAYS, ASKING, METHOD, OUTPUTS, RECORDED, SETTINGS, EpisodeConfig
from mpvi_bt.runs.choices.methods import Method, load_method
from mpvi_bt.runs.episode.saved_episode import SavedSettings

FIELDS = {field.name: field for field in fields(EpisodeConfig)}
OTHER = {  # a value of each setting of a method that is not as by default
    "planner": "none", "drive": "policy", "on_failure": "retry:2", "unit": "monitored", "calibration": "c.json",
    "map": "online", "detector": "oracle", "policy": "reactive", "policy_settings": "openpi_comet", "policy_horizon": 8,
    "policy_ensemble": 0.5, "policy_rate": 10.0, "policy_actions": "delta",
    "pregrasp": True, "pregrasp_hand": "left", "checker": "oracle", "trigger": "periodic:300", "while_asked": "hold",
    "policy_faults": "drift", "latency": "policy=0.4", "while_inferring": "go_on", "robot": "fetch", "sim": "maniskill",
    "assisted": True, "navigator": "my_navigator:mine",
}  # fmt: skip


def taken(*words: str) -> dict[str, Any]:
    """What a command without options of its own takes from --set."""

    @click.command()
    @method(*METHOD)
    def command(**given: Any) -> dict[str, Any]:
        return {name: value for name, value in given.items() if name != "method"}

    result = CliRunner().invoke(command, words, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return dict(result.return_value)


def test_every_field_is_kept_with_what_can_change_the_outcome_or_is_an_output_or_asks() -> None:
    """A new field is recorded, unless its group says that it cannot matter; every group's fields are an episode's."""
    assert sorted((*RECORDED, *OUTPUTS, *ASKING)) == sorted(FIELDS)
    assert set(SETTINGS) < set(FIELDS)
    decided = {
        "task",
        "method",
        "arguments",
        "suite_budget",
        "trace",
        "saved",
        "planned",
        "only_failures",
    }  # by arguments and folders
    assert set(FIELDS) - set(SETTINGS) == decided


@pytest.mark.parametrize("name", FIELDS)
def test_a_field_is_found_wherever_settings_are_taken(name: str) -> None:
    """In saved episodes, Python's keywords, method files, and options or --set, with the same default."""
    default = FIELDS[name].default
    assert (name in SavedSettings.model_fields) == (name in RECORDED)
    assert (name in Method.model_fields) == (name in METHOD)
    keywords = inspect.signature(mpvi_bt.run).parameters
    options = {option.name: option for option in run.params}
    if name in SETTINGS:
        assert options[name].help
        assert options[name].default == default
        if name not in ("tree", "plan"):  # may be loaded ones, too
            assert keywords[name].default == default
    if name in RECORDED and name not in ALWAYS and name != "arguments":
        assert SavedSettings.model_fields[name].default == default
    if name in METHOD:
        assert taken("--set", f"{name}={str(OTHER[name]).lower()}") == {name: OTHER[name]}


def test_methods_set_all_that_set_does(tmp_path: Path) -> None:
    """One word for a setting: the name in a method file is that behind --set, in records and in saved episodes."""
    file = tmp_path / "mine.yaml"
    file.write_text("about: All.\n" + "".join(f"{name}: {str(v).lower()}\n" for name, v in OTHER.items()))
    loaded = dict(load_method(str(file)))
    assert loaded == {"method": "mine", **OTHER}
    record = EpisodeConfig("t", **loaded).record()
    assert record.items() >= loaded.items()
    assert EpisodeConfig("t", **loaded) == EpisodeConfig(**{**SavedSettings(**record).model_dump(), "arguments": ()})


def test_what_is_by_default_is_not_recorded_anew() -> None:
    """A new setting leaves the records of before as they are, so that their folders can be gone on with."""
    assert set(EpisodeConfig("t").record()) == {
        "task", "instance", "seed", "policy", "detector", "checker", "trigger", "planner", "map", "while_asked", "tree",
        "plan",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("policy_horizn=8", "--set: unknown setting 'policy_horizn'. Did you mean 'policy_horizon'?"),
        ("policy_horizon", "--set wants NAME=VALUE, not 'policy_horizon'."),
        ("policy_horizon=few", "--set policy_horizon: 'few' is not a valid integer range."),
        ("policy_horizon=0", "--set policy_horizon: 0 is not in the range x>=1."),
        ("policy_ensemble=nan", "--set policy_ensemble: nan is no finite number."),
        ("drive=nobody", "--set drive: 'nobody' is not one of 'navigator', 'policy'."),
        ("policy=reactiv", "--set policy: unknown policy 'reactiv'. Did you mean 'reactive'?"),
        ("on_failure=retri:2", "retry"),
        ("assisted=perhaps", "--set assisted: 'perhaps' is not a valid boolean."),
    ],
)
def test_what_set_cannot_take_is_told_with_what_it_could(text: str, said: str) -> None:
    """Names by the nearest match, values by what would be valid."""
    with pytest.raises(UserError) as caught:
        taken("--set", text)
    assert said in str(caught.value)


def test_set_overrides_methods_and_options_override_set() -> None:
    """In whatever order they stand; what has no option is set all the same."""
    words = ["smoke", "--policy", "expert", "--set", "policy=reactive", "--set", "trigger=periodic:9"]
    run_suite = suite.commands["run"]
    context = run_suite.make_context("run", [*words, "--set", "robot=fetch", "--method", "no_trigger"])
    given = context.params
    assert (given["policy"], given["trigger"], given["robot"], given["map"]) == (
        "expert", "periodic:9", "fetch", load_method("no_trigger")["map"],
    )  # fmt: skip


def test_the_robots_that_are_offered_are_those_that_there_are() -> None:
    """Tab completion has the names of their files."""
    (option,) = (option for option in run.params if option.name == "robot")
    context = run.make_context("run", ["turning_on_radio"])
    assert {item.value for item in option.shell_complete(context, "")} >= set(ROBOTS)


def test_the_names_of_shipped_methods_are_those_of_settings() -> None:
    """None says what an episode does not know."""
    for name in paths.names("tasks/methods"):
        assert set(load_method(name)) <= {"method", *METHOD}
