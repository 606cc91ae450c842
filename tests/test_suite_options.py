"""What is asked of the episodes of a suite is asked by the same options as of one episode."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from mpvi_bt.apps.cli.run import run
from mpvi_bt.apps.cli.suite import suite
from mpvi_bt.runs.choices.config import ONE_EPISODES, SETTINGS, EpisodeConfig
from mpvi_bt.runs.suite.play import Kept

ONLY_RUN = {
    "task": "a suite's file lists tasks; there --task chooses among them",
    "instance": "a suite's file lists instances; there --instance chooses among them, and may be repeated",
    "seed": "a suite's file lists seeds",
    "video": "a suite films into its folder: there the option says which episodes",
    "picture": "a suite draws into its folder: there it is a flag",
    "mcap": "a suite records into its folder: there it is a flag",
    "demonstration": "a suite records into its folder: --demonstrations is a flag",
    "profile": "it is of one process; episodes of a suite share the machine",
    "rerun": "a log of one episode is too large to keep of hundreds",
    "times": "the answer times of one episode are enough to be replayed",
    "dry": "a suite is scored, and a dry run has no score",
    "resume": "a suite goes on with the episodes that have no result, from their beginning",
    "breaks": "nobody sits before each worker to step it",
    "step": "nobody sits before each worker to step it",
    "watch": "episodes that run side by side cannot share a terminal's tree",
    "unicode": "how that tree is drawn",
}
ONLY_SUITE = {
    "name": "names the suite",
    "tasks": "--task: which of the suite's episodes are played now",
    "instances": "--instance: which of the suite's episodes are played now",
    "houses": "--house is the one house of an episode",
    "workers": "one episode has one process",
    "wall_limit": "one episode is stopped by Ctrl-C",
    "engine": "one episode runs here",
    "ray_address": "one episode runs here",
    "episode": "hidden, for tests",
    "video": "see above",
    "picture": "see above",
    "mcap": "see above",
    "demonstrations": "see above",
    "suite_calls": "--calls is the limit of one episode",
    "suite_tokens": "--tokens is the limit of one episode",
}
APART = ("out", "trace", "as_json")  # the same words, with a folder and a help of their own


def options(command: click.Command) -> dict[str, dict[str, object]]:
    """Each parameter as help and documentation tell of it, by its name."""
    return {str(p.name): {**p.to_info_dict(), "type": repr(p.type)} for p in command.params}


def test_a_suite_takes_every_option_of_one_episode() -> None:
    """The same name, type, default and help; what only one of the commands has is listed here with the reason."""
    one, many = options(run), options(suite.commands["run"])
    assert one.keys() - many.keys() <= ONLY_RUN.keys() <= one.keys()
    assert many.keys() - one.keys() <= ONLY_SUITE.keys() <= many.keys()
    shared = (one.keys() & many.keys()) - ONLY_RUN.keys() - set(APART)
    assert shared >= SETTINGS.keys() - set(ONE_EPISODES) | {"method", "params", "serve"}
    for name in shared:
        told = [{key: str(value) for key, value in command[name].items() if key != "type"} for command in (one, many)]
        assert told[0] == told[1], name
        assert one[name]["type"].split(" at 0x")[0] == many[name]["type"].split(" at 0x")[0]  # type: ignore[attr-defined]


@pytest.mark.parametrize("words", [["--robot", "r1pro"], ["--method", "expert", "--robot", "r1pro"]])
def test_the_robot_of_a_suite_is_chosen_by_an_option(words: list[str]) -> None:
    """It overrides the method's, as for one episode."""
    context = suite.commands["run"].make_context("run", ["smoke", *words])
    assert context.params["robot"] == "r1pro"
    assert context.get_parameter_source("robot") is click.core.ParameterSource.COMMANDLINE


@pytest.mark.parametrize(("words", "video"), [([], None), (["--video"], "all"), (["--video", "failures"], "failures")])
def test_a_suite_films_all_episodes_or_those_that_fail(words: list[str], video: str | None) -> None:
    """What is said behind the option tells every episode what becomes of its film."""
    given = suite.commands["run"].make_context("run", ["smoke", *words]).params["video"]
    config = Kept(video=given).of(EpisodeConfig("t"), Path("out"))
    assert given == video
    assert config.video == (None if video is None else Path("out/videos/t_0_0.mp4"))
    assert config.only_failures == (video == "failures")
