"""`import mpvi_bt`: what it offers does what the commands do, is typed, and costs nothing until it is used."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import mpvi_bt
from mpvi_bt.apps import api
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.store import Store
from tests import setting_keywords
from tests.conftest import Shell
from tests.fake_episodes import fake_result

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("name", mpvi_bt.__all__)
def test_what_is_offered_is_there(name: str) -> None:
    """Each name leads to something with a docstring of its own, and completion knows it."""
    assert inspect.getdoc(getattr(mpvi_bt, name))
    assert name in dir(mpvi_bt)


def test_type_checkers_see_what_is_offered() -> None:
    """The imports that only they read name the same as `__all__`."""
    source = Path(mpvi_bt.__file__).read_text(encoding="utf-8")
    block = source.partition("if TYPE_CHECKING:")[2].partition("\n\n")[0]
    seen = [name.strip() for line in block.splitlines()[1:] for name in line.partition(" import ")[2].split(",")]
    assert sorted(seen) == sorted(mpvi_bt.__all__)


def test_type_checkers_know_every_setting_by_keyword() -> None:
    """A keyword that is misspelt, or of another type, is found before anything runs."""
    assert setting_keywords.FILE.read_text(encoding="utf-8") == setting_keywords.text(), (
        "python -m tests.setting_keywords"
    )


def test_what_is_not_offered_is_no_attribute() -> None:
    """As of any module, so that `hasattr` and the import of submodules work."""
    assert not hasattr(mpvi_bt, "rum")
    with pytest.raises(AttributeError, match="has no attribute 'rum'"):
        mpvi_bt.rum  # noqa: B018


def test_trees_load_no_simulator() -> None:
    """Nor numpy: a tree is loaded, drawn and checked without."""
    code = (
        "import sys, mpvi_bt\ntree = mpvi_bt.load_tree('fetch', to='sofa')\nstr(tree), tree._repr_html_()\n"
        "assert mpvi_bt.compile_plan('picking_up_trash').nodes and mpvi_bt.check('hello') == []\n"
        "print([m for m in ('numpy', 'sapien', 'torch', 'py_trees') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"polcy": "expert"}, "unknown key 'polcy'. Did you mean 'policy'?"),
        ({"instance": "first"}, "instance: should be a whole number, not 'first'"),
        ({"seed": -1}, "seed: should be greater than or equal to 0, not -1"),
        ({"drive": "nobody"}, "drive: 'nobody' is not valid."),
        ({"policy": "expret"}, "Did you mean 'expert'?"),
        ({"instance": 99}, "instance 99 is out of range"),
        ({"tree": "ftch"}, "Did you mean 'fetch'?"),
        ({"method": "mvpi"}, "Did you mean 'mpvi'?"),
        ({"tree": "hello", "on_failure": "replan"}, "--on-failure is for plans"),
    ],
)
def test_what_is_wrong_is_told_before_a_simulator_loads(settings: dict[str, typing.Any], said: str) -> None:
    """As the command line tells it: what was given, and what would be valid."""
    with pytest.raises(mpvi_bt.UserError) as caught:
        mpvi_bt.run("picking_up_trash", **settings)
    assert said in str(caught.value)


def test_a_method_holds_where_nothing_else_is_said() -> None:
    """What is given beside a method overrides it, also where that is what holds by default."""
    config, _ = api._asked("run", "picking_up_trash", "e2e", None, None, None, {"planner": "recorded"})
    assert (config.method, config.planner, config.policy) == ("e2e", "recorded", "reactive")


def test_a_dry_run_is_that_of_the_command(mpvi: Shell) -> None:
    """A tree by name with arguments, the same tree loaded, and the command end alike."""
    done = mpvi("run", "--dry", "--tree", "fetch", "--param", "to=sofa", "--json")
    told = json.loads(done.stdout)
    by_name = mpvi_bt.run_dry("fetch", arguments={"to": "sofa"})
    loaded = mpvi_bt.run_dry(mpvi_bt.load_tree("fetch", to="sofa"))
    for outcome in (by_name, loaded):
        assert (outcome.ending, outcome.ticks) == (told["ended"], told["ticks"])


def test_rules_make_a_dry_run_fail() -> None:
    """The failure says where and why."""
    outcome = mpvi_bt.run_dry("fetch", substitute=ROOT / "examples" / "blocked.yaml")
    assert outcome.ending == "failure"
    assert outcome.failure is not None
    assert (outcome.failure.reason, outcome.failure.path.count("/") > 0) == ("all_failed", True)


def test_a_tree_of_no_file_is_checked_like_one_of_a_file() -> None:
    """A room that the house lacks is refused, and parameters are not filled in twice."""
    lost = parse_tree("tree: t\nroot: {navigate: sofa, room: sauna}\n")
    with pytest.raises(mpvi_bt.FileProblems, match="unknown room 'sauna'"):
        mpvi_bt.run("picking_up_trash", tree=lost)
    with pytest.raises(mpvi_bt.UserError, match="filled in where it is loaded"):
        mpvi_bt.run_dry(mpvi_bt.load_tree("fetch"), arguments={"to": "sofa"})


def test_check_finds_what_the_command_finds(tmp_path: Path, mpvi: Shell) -> None:
    """The same problems, typed."""
    (tmp_path / "t.yaml").write_text("tree: t\nroot: {sequnce: x, children: [{navigate: sofa}]}\n")
    found = mpvi_bt.check(tmp_path)
    told = json.loads(mpvi("check", "--json", str(tmp_path)).stdout)["problems"]
    assert [(p.line, p.column, p.code) for p in found] == [(p["line"], p["column"], p["code"]) for p in told]
    assert found


def test_a_tree_shows_itself(mpvi: Shell) -> None:
    """`print` draws it as `mpvi render` does; a notebook gets a picture whose styles stay its own."""
    tree = mpvi_bt.load_tree("hello")
    assert str(tree) == mpvi("render", "hello").stdout.rstrip("\n")
    html = tree._repr_html_()
    assert html is not None
    assert html.startswith('<img src="data:image/svg+xml;base64,')


def test_a_result_shows_q_first_and_nothing_of_it_becomes_markup() -> None:
    """Whatever a policy said of its failure."""
    data = fake_result(mpvi_bt.EpisodeConfig("picking_up_trash"))
    data["failures"] = [{"node": "a/b", "reason": "gave_up", "feedback": "<script>alert(1)</script>", "time_s": 3.0}]
    result = Result.model_validate(data)
    html = result._repr_html_()
    assert f"q = {result.q:.3f}" in html.partition("<tbody>")[0]
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert f"q = {result.q:.3f}" in str(result)


def test_a_suite_goes_on_where_it_stopped_and_its_report_is_typed(tmp_path: Path) -> None:
    """Episodes that have a result are not run again; settings override what methods say."""
    (tmp_path / "two.yaml").write_text("about: Two.\ntasks: [picking_up_trash]\ninstances: [0, 1]\n")
    store = Store(tmp_path / "out")
    for instance in (0, 1):
        config = mpvi_bt.EpisodeConfig("picking_up_trash", instance, detector="oracle")
        store.write(config, fake_result(config))
    told = mpvi_bt.run_suite(tmp_path / "two.yaml", out=tmp_path / "out", detector="oracle", progress=False)
    assert [(r.instance_id, r.config["detector"]) for r in told.results] == [(0, "oracle"), (1, "oracle")]
    assert told.faults == {}
    assert "two: 2/2 episodes" in str(told)
    assert told._repr_html_().startswith("<pre>")


def test_a_result_of_another_setting_is_not_mixed_in(tmp_path: Path) -> None:
    """As of the command: another folder is asked for."""
    (tmp_path / "one.yaml").write_text("about: One.\ntasks: [picking_up_trash]\ninstances: [0]\n")
    config = mpvi_bt.EpisodeConfig("picking_up_trash")
    Store(tmp_path / "out").write(config, fake_result(config))
    with pytest.raises(mpvi_bt.UserError, match="a result of another configuration"):
        mpvi_bt.run_suite(tmp_path / "one.yaml", out=tmp_path / "out", checker="oracle", progress=False)


PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


def test_the_page_begins_with_the_example() -> None:
    """Which the tests of examples run."""
    example = (ROOT / "examples" / "09_in_ten_lines.py").read_text(encoding="utf-8")
    assert BLOCKS[0] == example.partition('"""\n\n')[2]
    assert len(BLOCKS[0].replace("\n\n", "\n").splitlines()) == 10


def test_the_page_names_every_call() -> None:
    """Once each, in its table."""
    calls = {name for name in mpvi_bt.__all__ if inspect.isfunction(getattr(mpvi_bt, name))}
    assert calls == set(re.findall(r"`(\w+)\(", PAGE.partition("## Trees")[0])) - {"help"}


def test_what_the_page_says_of_trees_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As it stands there, in a clone."""
    monkeypatch.chdir(ROOT)
    exec(BLOCKS[1], {})
    assert capsys.readouterr().out.startswith("success ")
