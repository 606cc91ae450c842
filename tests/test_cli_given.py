"""What people give on the command line: completed by Tab, read from standard input, refused where it is not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpvi_bt.ground import paths
from tests.conftest import Shell


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("render pick_", ["file,pick_", "plain,pick_up"]),
        ("convert picking", ["file,picking", "plain,picking_up_trash"]),
        ("compile picking_up_tr", ["file,picking_up_tr", "plain,picking_up_trash"]),
        ("run picking", ["plain,picking_up_toys", "plain,picking_up_trash"]),
        ("run --tree ./", ["file,./"]),
        ("run --resume runs/", ["file,runs/"]),
        ("run --substitute r", ["file,r"]),
        ("explain r", ["file,r"]),
        ("replay r", ["file,r"]),
        ("diff a b", ["file,b"]),
        ("suite run trash", ["file,trash", "plain,trash10"]),
        ("suite run trash10 --tree hel", ["file,hel", "plain,hello"]),
        ("run --tree pick_up --param o", ["plain,object="]),
        ("render pick_up --param h", ["plain,hand="]),
        ("run --tree hello --break ", ["plain,say"]),
        ("run --break ", []),
        ("run --tree nope --param ", []),
    ],
)
def test_tab_offers_what_fits(words: str, offered: list[str], mpvi: Shell) -> None:
    """Names, files, parameters and paths of the tree that is given; never an error."""
    count = len(words.split(" "))
    done = mpvi(_MPVI_COMPLETE="bash_complete", COMP_WORDS=f"mpvi {words}", COMP_CWORD=str(count))
    assert (done.stdout.split("\n"), done.stderr) == ([*offered, ""] if offered else ["", ""], "")


def test_a_dash_is_the_standard_input(mpvi: Shell, tmp_path: Path) -> None:
    """Of a tree and of a trace."""
    tree = (paths.shipped() / "trees/hello.yaml").read_text()
    assert mpvi("render", "-", stdin=tree).stdout == mpvi("render", "hello").stdout
    mpvi("run", "--dry", "--tree", "hello")
    trace = (tmp_path / "runs/hello_dry.trace.jsonl").read_text()
    for command in ("explain", "replay"):
        assert mpvi(command, "-", stdin=trace).stdout == mpvi(command, "runs/hello_dry.trace.jsonl").stdout


def test_a_tree_is_drawn_with_its_parameters(mpvi: Shell) -> None:
    """As `mpvi run` fills them in; one that is not there is refused, and so is one without a value."""
    assert 'Manipulate("pick up the cup with' in mpvi("render", "pick_up", "--param", "object=cup").stdout
    for param in ("objct=cup", "object=", "object"):
        assert mpvi("render", "pick_up", "--param", param).returncode == 2
        assert mpvi("run", "--dry", "--tree", "pick_up", "--param", param).returncode == 2


@pytest.mark.parametrize("decay", ["nan", "inf", "-inf", "-1", "much"])
def test_a_decay_that_is_no_finite_number_is_told_in_one_line(decay: str, mpvi: Shell) -> None:
    """Before anything is set up."""
    done = mpvi("run", "picking_up_trash", "--policy-ensemble", decay)
    assert (done.returncode, done.stderr.count("\n"), "--policy-ensemble" in done.stderr) == (2, 1, True)


@pytest.mark.parametrize(
    "words", [("--policy-settings", "openpi_comet"), ("--policy-horizon", "3"), ("--policy-ensemble", "0.1")]
)
def test_a_dry_run_takes_no_word_on_how_to_drive_a_policy(words: tuple[str, str], mpvi: Shell) -> None:
    """Since it drives none."""
    done = mpvi("run", "--dry", "--tree", "hello", *words)
    assert (done.returncode, f"{words[0]} can't be given" in done.stderr) == (2, True)


def test_a_tree_in_the_place_of_a_task_is_told(mpvi: Shell) -> None:
    """With the command that was meant."""
    assert "It is a tree: mpvi run --dry --tree hello." in mpvi("run", "hello", "--dry").stderr


def test_a_suite_refuses_a_tree_that_is_not_there(mpvi: Shell) -> None:
    """As a run does; status and report take no trees."""
    done = mpvi("suite", "run", "trash10", "--tree", "nope")
    assert (done.returncode, "unknown tree 'nope'" in done.stderr) == (2, True)
