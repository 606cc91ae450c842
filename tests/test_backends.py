"""Laws of how backends are named, listed and made."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import pytest

from mpvi_bt.apps.cli.argument_types import BackendType
from mpvi_bt.executive.actions.chunks import RecedingHorizon, TemporalEnsemble
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.backends import BACKENDS, choose, privileged
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.plugins import OFFERED, asked_for
from mpvi_bt.runs.choices.policies import PolicyInputs, check_policy_choice, in_chunks, make_policy
from mpvi_bt.runs.episode.episode import _renders
from mpvi_bt.runs.episode.prepare import check_backends
from mpvi_bt.runs.episode.saved_episode import SavedSettings
from mpvi_bt.testing import GripPolicy
from tests.conftest import Shell

CONFIG = EpisodeConfig("picking_up_trash")
THERE = "openpi:ws://localhost:8000"


# What the makers of our own backends are offered besides what parts of other packages are.
OURS = {
    "policy": {"ground", "settings"},
    "checker": {"world", "models", "detector"},
    "detector": set(),
    "trigger": set(),
}


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in OURS for name in BACKENDS[kind]])
def test_every_backend_that_is_listed_can_be_made(kind: str, name: str) -> None:
    """Each names its factory, and that asks for nothing but what its kind is offered."""
    module, _, function = BACKENDS[kind][name].factory.partition(":")
    wanted = {p.name for p in asked_for(getattr(importlib.import_module(module), function))}
    assert wanted <= {*OFFERED[kind], *OURS[kind], "address", "given"}


def test_a_choice_is_a_name_or_a_name_and_an_address() -> None:
    """The address is what comes after the first colon."""
    choice = choose("policy", THERE)
    assert (choice.name, choice.address) == ("openpi", "ws://localhost:8000")
    assert choice.backend is BACKENDS["policy"]["openpi"]
    assert choose("policy", "expert").address == ""
    assert privileged({"policy": THERE, "checker": "oracle"}) == ["checker:oracle"]


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ("exprt", UnknownName, "Did you mean 'expert'"),
        ("opnpi:ws://localhost", UnknownName, "Did you mean 'openpi'"),
        ("openpi", UserError, "such as openpi:ws://HOST:PORT"),
        ("openpi:", UserError, "such as openpi:ws://HOST:PORT"),
        ("expert:there", UserError, "has no address"),
        ("openpi:ftp://localhost", UserError, "no address of a policy server"),
        ("", UnknownName, "Known:"),
    ],
)
def test_a_choice_that_cannot_be_is_refused_before_anything_starts(given: str, error: Any, said: str) -> None:
    """With what would be valid."""
    with pytest.raises(error, match=said):
        check_policy_choice(replace(CONFIG, policy=given))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"policy_settings": "openpi_comet"}, "has no settings"),
        ({"policy": THERE, "policy_settings": "openpi_comt"}, "Did you mean 'openpi_comet'"),
        ({"policy_horizon": 5, "policy_ensemble": 0.01}, "give one of them"),
    ],
)
def test_settings_that_do_not_fit_are_refused(changes: dict[str, Any], said: str) -> None:
    """Likewise, when an episode is prepared."""
    with pytest.raises(UserError, match=said):
        check_backends(replace(CONFIG, **changes))


def test_a_remote_policy_is_made_without_its_server() -> None:
    """It is connected to only when it is first used."""
    assert make_policy(THERE, PolicyInputs({}), "openpi_comet").name == THERE


def test_what_reads_the_simulator_is_not_made_without_one() -> None:
    """The expert cannot be served."""
    with pytest.raises(UserError, match="reads the simulator"):
        make_policy("expert", PolicyInputs(load_skills()))


def test_chunks_are_carried_out_as_the_config_says() -> None:
    """Whole, in part, or averaged."""
    policy = GripPolicy(load_skills())
    assert in_chunks(policy, CONFIG) is policy
    assert isinstance(in_chunks(policy, replace(CONFIG, policy_horizon=3)), RecedingHorizon)
    assert isinstance(in_chunks(policy, replace(CONFIG, policy_ensemble=0.0)), TemporalEnsemble)


@pytest.mark.parametrize(
    ("changes", "renders"),
    [
        ({}, False),
        ({"checker": "visual"}, True),
        ({"policy": "reactive"}, True),
        ({"policy": THERE}, True),
        ({"video": Path("film.mp4")}, True),
        ({"rerun": Path("run.rrd")}, True),
        ({"mcap": Path("run.mcap")}, True),
    ],
)
def test_a_world_renders_where_somebody_looks(changes: dict[str, Any], renders: bool) -> None:
    """And only there: it costs time."""
    assert _renders(replace(CONFIG, **{"checker": "oracle", "detector": "oracle", **changes})) is renders


def test_a_config_says_how_the_policy_is_driven_only_where_that_was_asked_for() -> None:
    """So that results of before still are of the same configuration; a saved episode takes all of it up again."""
    assert not [key for key in CONFIG.record() if key.startswith("policy_")]
    driven = replace(CONFIG, policy=THERE, policy_settings="openpi_comet", policy_ensemble=0.0)
    record = driven.record()
    assert (record["policy_settings"], record["policy_ensemble"], "policy_horizon" in record) == (
        "openpi_comet", 0.0, False,
    )  # fmt: skip
    assert SavedSettings(**record).policy_ensemble == 0.0


def test_names_are_completed() -> None:
    """With the colon where an address follows."""
    context = click.Context(click.Command("run"))
    parameter = click.Option(["--policy"])
    items = BackendType("policy").shell_complete(context, parameter, "")
    assert [item.value for item in items] == [
        "expert",
        "reactive",
        "learned",
        "openpi:",
        "vla_eval:",
        "groot:",
        "lerobot:",
    ]
    assert [item.value for item in BackendType("policy").shell_complete(context, parameter, "re")] == ["reactive"]


@pytest.mark.slow
@pytest.mark.render
def test_an_episode_without_its_policys_server_is_the_backends_failure(mpvi: Shell, tmp_path: Path) -> None:
    """Exit code 3, a result that says so with the reason, and a trace that `mpvi explain` reads."""
    (tmp_path / "soon.yaml").write_text("about: a server that is soon given up\nconnect_s: 0.3\nanswer_s: 1\n")
    (tmp_path / "tree.yaml").write_text(
        "tree: t\nroot:\n  timeout: 5\n  child: {manipulate: pick up the can of soda}\n"
    )
    args = ["--policy", "openpi:ws://127.0.0.1:9", "--policy-settings", "soon.yaml", "--tree", "tree.yaml"]
    done = mpvi("run", "picking_up_trash", "--checker", "oracle", "--no-watch", *args)
    assert done.returncode == 3, done.stderr
    assert "BACKEND ERROR" in done.stdout.splitlines()[0]
    result = json.loads((tmp_path / "runs" / "picking_up_trash_0_0.json").read_text())
    assert result["ended"] == "backend_error"
    assert result["failures"][-1]["reason"] == "server_absent"
    said = mpvi("explain", "runs/picking_up_trash_0_0.trace.jsonl").stdout
    assert "server_absent" in said
