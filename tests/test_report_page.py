"""The page and the Markdown of a suite: what they tell, that they stand alone, and that hostile text stays text."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from mpvi_bt.executive.tree.yaml_io import expanded, parse_tree
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import ConditionRecord, FailureRecord, Result
from mpvi_bt.runs.episode.way import Way
from mpvi_bt.runs.report.data import report_data
from mpvi_bt.runs.report.figures import figures
from mpvi_bt.runs.report.markdown import plain, report_markdown
from mpvi_bt.runs.report.page import report_page
from mpvi_bt.runs.report.paper import paper_scores
from mpvi_bt.runs.report.plot_svg import method_colors
from mpvi_bt.runs.report.plots import improvement_plot, method_plot, shown_tasks
from mpvi_bt.runs.report.runs import Runs
from mpvi_bt.runs.report.statistics import Estimate
from mpvi_bt.runs.report.tables import comparison_text, missing_table, percent, told
from mpvi_bt.runs.suite.store import Fault, Store
from tests.conftest import Shell
from tests.fake_episodes import fake_result
from tests.synthetic_suites import TASKS, synthetic_runs
from tests.test_html import BROWSER, EVIL, Tags, in_browser

GOLDEN = Path(__file__).parent / "golden" / "report.md"
FIVE = {"e2e": 0.1, "mpvi": 0.6, "oracle_localization": 0.7, "subtask_prediction": 0.5, "no_trigger": 0.4}


def page_of(runs: Sequence[Runs], about: str = "", page: Path | None = None) -> str:
    return report_page(figures("suite", runs, about), runs, page)


def episodes_in(page: Tags) -> list[list[str]]:
    """The classes of each episode."""
    found = [(a.get("class") or "").split() for tag, a in page.tags if tag == "details"]
    return [classes for classes in found if "episode" in classes]


def two() -> list[Runs]:
    return [synthetic_runs("e2e", 0.2), synthetic_runs("mpvi", 0.7)]


def write_trace(folder: Path, config: EpisodeConfig, leaves: int, word: str = "go on") -> None:
    """A trace in which leaf after leaf runs for a second, each fourth until a timeout cuts it off."""
    nodes = [{"attempt": f"n{i}", "child": {"say": f"{word} {i}"}} for i in range(leaves)]
    tree = parse_tree(json.dumps({"tree": "t", "root": {"sequence": "s", "memory": True, "children": nodes}}), "t.json")
    lines: list[dict[str, object]] = [{"trace": 1, "mpvi_bt": "0", "tree": expanded(tree)}]
    paths = [node.path for node in tree.nodes if node.spec.type.family == "leaf"]
    for i, path in enumerate(paths):
        above = path.rsplit("/", 1)[0]
        over = {"status": "INVALID", "interrupted": True} if i % 4 == 3 else {"status": "SUCCESS"}
        lines.append({"tick": 2 * i + 1, "time_s": float(i), "nodes": {path: {"status": "RUNNING"}}})
        lines.append(
            {
                "tick": 2 * i + 2, "time_s": i + 1.0,
                "nodes": {above: {"status": "SUCCESS", "gave_up": i % 4 == 3}, path: over},
            }
        )  # fmt: skip
    file = folder / "traces" / f"{config.name}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")


def hostile(folder: Path | None = None) -> list[Runs]:
    """Two methods whose every word is an attack."""
    every = []
    for method in ("harmless", EVIL[:60]):
        configs = [EpisodeConfig(EVIL, i) for i in range(3)]
        result = Result.model_validate(fake_result(configs[0])).model_copy(
            update={
                "task": EVIL, "ended": EVIL, "privileged": [EVIL], "config": {EVIL: EVIL, "assisted": True},
                "goal": [ConditionRecord(condition=EVIL, satisfied=ok) for ok in (True, False)],
                "failures": [FailureRecord(node=f"a/{EVIL}", reason=EVIL, feedback=EVIL)],
                "way": Way(base=[[0, 0], [1, 2]], things={EVIL: [[0, 0], [3, 3]]}),
            }
        )  # fmt: skip
        faults = {configs[2]: Fault(EVIL)}
        every.append(Runs(method, configs, dict.fromkeys(configs[:2], result), faults, folder, EVIL))
    return every


def test_hostile_text_stays_text() -> None:
    """A page whose every word is an attack has no element and no attribute that a harmless one has not."""
    evil, calm = Tags(page_of(hostile(), EVIL)), Tags(page_of([*two(), synthetic_runs("a", 0.5, finished=0.5)], "word"))
    assert {tag for tag, _ in evil.tags} <= {tag for tag, _ in calm.tags}
    assert {name for _, found in evil.tags for name in found} <= {name for _, found in calm.tags for name in found}
    assert page_of(hostile(), EVIL).count("&lt;/script&gt;&lt;script&gt;document.title=") > 20


def test_nothing_runs_or_loads() -> None:
    """The policy allows our style by its hash and films of the same place; no element names another address."""
    page = Tags(page_of(hostile(), EVIL))
    policy = next(a["content"] for tag, a in page.tags if a.get("http-equiv") == "Content-Security-Policy") or ""
    digest = base64.b64encode(hashlib.sha256(page.inside["style"][0].encode()).digest()).decode()
    assert policy.startswith(f"default-src 'none'; style-src 'sha256-{digest}'; media-src 'self' file:; img-src 'self'")
    links = [a for tag, attributes in page.tags for n, a in attributes.items() if n in ("src", "href", "style") and a]
    assert links
    assert all(link.startswith("#") for link in links)
    assert not re.search(r"url\(|@import", page.inside["style"][0])


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_hostile_text_is_inert_in_a_browser(tmp_path: Path) -> None:
    """No attack runs, and each is shown as it was written."""
    shown = in_browser(page_of(hostile(), EVIL), tmp_path)
    assert "<title>suite</title>" in shown
    assert "document.title='evil'" in shown
    assert not [tag for tag, _ in Tags(shown).tags if tag in ("img", "script")]


@pytest.mark.parametrize(
    "runs",
    [
        [synthetic_runs("only", 1.0)],
        [synthetic_runs("only", 0.0, finished=0.0)],
        [synthetic_runs("e2e", 0.3, finished=0.0), synthetic_runs("mpvi", 0.6, finished=0.1)],
        [synthetic_runs("e2e", 0.0), synthetic_runs("mpvi", 0.0)],
        [synthetic_runs("mine", 0.4, tasks=["a_task_that_is_gone"], instances=1)],
        [synthetic_runs(name, share, finished=0.6) for name, share in FIVE.items()],
    ],
)
def test_whatever_is_there_is_told(runs: list[Runs]) -> None:
    """One method or many, all results, some, none, tasks without a file: every link leads somewhere."""
    page = Tags(page_of(runs))
    marks = {a["id"] for _, a in page.tags if "id" in a}
    assert {(a.get("href") or "#")[1:] for tag, a in page.tags if tag in ("a", "use")} <= marks
    text, plots = report_markdown(figures("suite", runs), "report")
    assert set(re.findall(r"!\[[^]]*\]\(([^)]*)\)", text)) == set(plots)
    done = sum(len(run.results) for run in runs)
    assert f"{done} of {sum(len(run.episodes) for run in runs)} episodes have a result" in text
    assert len(episodes_in(page)) == done


def test_pages_say_the_numbers_of_the_json() -> None:
    """Every mean of q with its interval, the improvement, and each count of failures, in HTML and in Markdown."""
    runs = two()
    found = figures("suite", runs)
    data = json.loads(json.dumps(report_data(found, runs)))
    html, (markdown, _) = page_of(runs), report_markdown(found, "report")
    for name, method in data["methods"].items():
        overall = method["overall"]
        row = next(line for line in markdown.splitlines() if line.startswith(f"| {name} | {overall['finished']}/"))
        q = next(m for m in data["figures"]["methods"] if m["name"] == name)["overall"]["measures"]["q_score"]
        assert f"{q['mean']:.3f} [{q['low']:.3f}, {q['high']:.3f}]" in row
        assert f"{q['mean']:.3f} <small>[{q['low']:.3f}, {q['high']:.3f}]</small>" in html
        assert q["mean"] == overall["q_score_of_finished"]
        for reason, count in next(m for m in data["figures"]["methods"] if m["name"] == name)["failures"][
            "reasons"
        ].items():
            assert re.search(rf"\| {reason} \|.* {count} ", markdown)
    change = data["figures"]["comparisons"][0]["relative"]["mean"]
    assert f"{change:+.0%}".replace("%", " %") in markdown
    assert f"{change:+.0%}".replace("%", " %") in html


def test_the_improvement_plot_has_a_bar_for_every_task() -> None:
    """Sorted by gain; gains, equals and regressions have their looks, and a baseline of nothing is hatched."""
    tasks = list(paper_scores()["mpvi"])[:9]
    found = figures("s", [synthetic_runs("e2e", 0.15, tasks, 2), synthetic_runs("mpvi", 0.3, tasks, 2)]).comparisons[0]
    plot = Tags(improvement_plot(found))
    looks = [a["class"] for tag, a in plot.tags if tag == "rect"][4:]  # behind the legend
    changes = sorted((p.difference.mean for p in found.tasks.values()), reverse=True)
    assert looks == ["gain" if c > 0 else "loss" if c < 0 else "same" for c in changes]
    assert {"gain", "loss", "same"} <= set(looks)
    hatched = sum(p.baseline == 0 and p.difference.mean > 0 for p in found.tasks.values())
    assert sum(a.get("class") == "hatch" for _, a in plot.tags) == hatched + 1
    assert (looks.count("gain"), looks.count("same"), looks.count("loss")) == (
        found.gains, found.equal, found.regressions,
    )  # fmt: skip


def test_the_method_plot_has_a_point_for_every_instance() -> None:
    """And a bar for every method in every panel; tasks on which nobody got anything are left out, and named."""
    nothing = [synthetic_runs(name, 0.0, tasks=["can_meat"]) for name in ("e2e", "mpvi")]
    runs = [
        Runs(a.method, [*a.episodes, *b.episodes], {**a.results, **b.results})
        for a, b in zip(two(), nothing, strict=True)
    ]
    found = figures("s", runs)
    plot = Tags(method_plot(found))
    assert shown_tasks(found) == list(TASKS)
    bars = [a for tag, a in plot.tags if tag == "rect" and "bar" in (a["class"] or "")]
    points = [a for tag, a in plot.tags if tag == "circle"]
    assert len(bars) == 2 * (len(TASKS) + 1)
    assert len(points) == 2 * (3 * len(TASKS) + len(TASKS) + 1)
    assert "Left out, since no method got anything: can_meat." in page_of(runs)


def test_an_episode_tells_what_ran_when(tmp_path: Path) -> None:
    """A row for every leaf that ran; what a timeout cut off has failed; a broken trace is said to be."""
    runs = synthetic_runs("mpvi", 0.6, TASKS[:1], folder=tmp_path)
    write_trace(tmp_path, runs.episodes[0], 8)
    write_trace(tmp_path, runs.episodes[1], 60)
    (tmp_path / "traces" / f"{runs.episodes[2].name}.jsonl").write_text("nothing\n")
    page = page_of([runs])
    rows = re.findall(r'<div class="row(?:" data-is="| )(\w+)">', page)
    assert rows == [
        *["success", "success", "success", "interrupted"] * 2,
        "axis",
        *["success", "success", "success", "interrupted"] * 10,
        "axis",
    ]
    assert "and 20 more that ran" in page
    assert "Its trace cannot be read" in page
    gone = page_of([replace(runs, folder=None)])
    assert gone.count("There is no trace") == 3


def test_films_are_linked_from_where_the_page_is(tmp_path: Path) -> None:
    """Whatever characters are in the names of folders; not where there is no film."""
    folder = tmp_path / "my runs" / "a&b #1"
    runs = synthetic_runs("mpvi", 0.6, TASKS[:1], folder=folder)
    film = folder / "videos" / f"{runs.episodes[1].name}.mp4"
    film.parent.mkdir(parents=True)
    film.touch()
    page = Tags(page_of([runs], page=tmp_path / "pages" / "report.html"))
    films = [a for tag, a in page.tags if tag == "video"]
    assert [a["src"] for a in films] == [f"../my%20runs/a%26b%20%231/videos/{film.name}"]
    assert films[0]["preload"] == "none"


def test_three_hundred_episodes_fit_in_five_megabytes(tmp_path: Path) -> None:
    """Thirty tasks, ten instances, each with a long way, fifty leaves that ran, and failures with long words."""
    tasks = list(paper_scores()["mpvi"])[:30]
    runs = synthetic_runs("mpvi", 0.3, tasks, 10, folder=tmp_path)
    long = [FailureRecord(node=f"t/{i}", reason="timeout", feedback="word " * 200) for i in range(30)]
    goal = [
        ConditionRecord(condition=f"inside(thing.n.01_{i}, other_thing.n.01_1)", satisfied=False) for i in range(60)
    ]
    way = Way(base=[[i % 7 / 3, i % 5 / 2] for i in range(300)])
    change = {"failures": long, "goal": goal, "way": way}
    results = {c: r.model_copy(update=change) for c, r in runs.results.items()}
    first, *others = results
    write_trace(tmp_path, first, 50, "pick up the can of soda with the right hand, then put it into the trash can")
    for config in others:
        shutil.copy(tmp_path / "traces" / f"{first.name}.jsonl", tmp_path / "traces" / f"{config.name}.jsonl")
    assert len(page_of([replace(runs, results=results)])) < 5e6


def test_markdown_is_as_it_was() -> None:
    """Golden: tests/golden/report.md; every figure in it follows from the synthetic results alone."""
    runs = [synthetic_runs(name, share, TASKS[:2], 2) for name, share in (("e2e", 0.2), ("mpvi", 0.7))]
    text, _ = report_markdown(figures("two_tasks", runs, "Two tasks, two methods."), "report")
    assert text == GOLDEN.read_text(encoding="utf-8")


def test_hostile_words_stay_in_their_cells() -> None:
    """Every row of every table has as many cells as its head, and nothing is markup."""
    text, plots = report_markdown(figures(EVIL, hostile(), EVIL), "report")
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+", name) for name in plots)
    width = None
    for line in text.splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line))
        if not line.startswith("|"):
            width = None
        else:
            width = width or cells
            assert cells == width
    assert not re.search(r"(?<!\\)[<>]", text)
    assert plain("[a](javascript:b) [1](c) # *d* `e` _f_ g_h [0.1, 0.2]") == (
        r"\[a\](javascript:b) [1\](c) # \*d\* \`e\` \_f\_ g_h [0.1, 0.2]"
    )


def test_the_command_writes_what_it_says(mpvi: Shell, tmp_path: Path) -> None:
    """The page, the Markdown and its plots; while results are missing; a baseline that is none is refused."""
    store = Store(tmp_path / "runs" / "trash10")
    for instance in range(3):
        config = EpisodeConfig("picking_up_trash", instance)
        store.write(config, fake_result(config))
    done = mpvi("suite", "report", "trash10", "--html", "a.html", "--markdown", "a.md")
    assert done.stdout.splitlines() == ["wrote a.html", "wrote a.md", "wrote a.methods.svg"], done.stderr
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "3 of 10 episodes have a result" in page
    assert "All ten instances of picking_up_trash, once each." in page
    assert "(a.methods.svg)" in (tmp_path / "a.md").read_text(encoding="utf-8")
    wrong = mpvi("suite", "report", "trash10", "--baseline", "exprt")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert "--baseline: unknown method 'exprt'. Did you mean 'expert'?" in wrong.stderr
    nowhere = mpvi("suite", "report", "trash10", "--html", "no/such/folder/a.html")
    assert nowhere.returncode == 2
    assert "no/such/folder/a.html: cannot be written" in nowhere.stderr


def test_what_is_missing_is_told_with_its_cause() -> None:
    """Each episode that broke, and how many of a task have not been run."""
    runs = synthetic_runs("mpvi", 0.5, TASKS[:2], 4, finished=0.5)
    broken = {runs.episodes[5]: Fault("the worker process died")}
    rows = missing_table(figures("s", [replace(runs, faults=broken)])).rows
    assert rows == [
        ["mpvi", "hiding_Easter_eggs_1_0", "the worker process died"],
        ["mpvi", "3 of hiding_Easter_eggs", "not run yet"],
    ]


def test_estimates_are_told_with_their_intervals() -> None:
    """With as many digits as asked for; nothing where there is nothing; nothing is less than 0 by rounding."""
    assert told(None) == "-"
    assert told(Estimate(-1e-17, -0.0004, 0.5)) == "0.000 [0.000, 0.500]"
    assert percent(Estimate(-1e-17, -0.25, None)) == "+0 % [-25 %, no bound]"
    assert percent(Estimate(1.126)) == "+113 %"
    found = figures("s", [synthetic_runs("a", 0.5, instances=1)]).methods[0].overall.measures["q_score"]
    assert found is not None
    assert told(found, 2) == f"{found.mean:.2f}"


def test_what_is_not_the_papers_is_not_set_beside_it() -> None:
    """Where other tasks were played, or some besides, the report draws no comparison with the paper."""
    for tasks in (["my_task"], ["my_task", TASKS[0]]):
        runs = [synthetic_runs("e2e", 0.2, tasks=tasks), synthetic_runs("mpvi", 0.7, tasks=tasks)]
        assert "paper" not in comparison_text(figures("suite", runs).comparisons[0])
    runs = [synthetic_runs("e2e", 0.2, tasks=["my_task"]), synthetic_runs("mpvi", 0.7, tasks=["my_task"])]
    text, plots = report_markdown(figures("suite", runs), "report")
    drawn = [re.sub(r"<style>.*?</style>", "", plot, flags=re.DOTALL) for plot in plots.values()]
    for told_so in (text, page_of(runs).partition("</head>")[2], *drawn):
        assert "paper" not in told_so
    assert "The paper's, on 50 tasks" in comparison_text(figures("suite", two()).comparisons[0])


@pytest.mark.parametrize("names", [["e2e", "mpvi"], ["mpvi", "e2e"], ["a", "b", "e2e", "c"]])
def test_the_baseline_is_gray_wherever_it_stands(names: list[str]) -> None:
    """And nothing else is: m0 of the style sheet is gray. One method alone has a color."""
    colors = dict(zip(names, method_colors(names, "e2e"), strict=True))
    assert colors["e2e"] == "m0"
    assert len(set(colors.values())) == len(names)
    assert method_colors(["e2e"], "e2e") == ["m1"]
    plot = method_plot(figures("suite", [synthetic_runs(name, 0.5) for name in names]))
    assert re.findall(r'<rect class="(m\d)"', plot)[: len(names)] == list(colors.values()), "the legend"


def test_a_reader_chooses_which_episodes_are_shown() -> None:
    """All, those that fall short, or those with a failure of one kind, each with how many there are."""
    runs = two()
    page = page_of(runs)
    results = [result for run in runs for result in run.results.values()]
    kinds = episodes_in(Tags(page))
    short = sum(not result.success for result in results)
    assert sum("short" in classes for classes in kinds) == short
    assert f"> short of the goal {short}</label>" in page
    choices = re.findall(r'id="only-why(\d+)"> (\w+) (\d+)<', page)
    assert choices
    for number, code, count in choices:
        assert sum(f"why{number}" in classes for classes in kinds) == int(count)
        assert int(count) == sum(code in {f.reason for f in result.failures} for result in results)


@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_a_browser_hides_what_is_not_chosen(tmp_path: Path) -> None:
    """By the style sheet alone: whether an episode is shown is what the browser computes of it."""
    runs = [synthetic_runs("mpvi", 0.7, TASKS[:1], 3)]
    page = (
        page_of(runs)
        .replace('id="only-all" checked', 'id="only-all"')
        .replace('id="only-short"', 'id="only-short" checked')
    )
    probe = (
        "<script>for (const e of document.querySelectorAll('.episode')) e.title = getComputedStyle(e).display</script>"
    )
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page).replace("</body>", f"{probe}</body>")
    shown = [a for tag, a in Tags(in_browser(free, tmp_path)).tags if "episode" in (a.get("class") or "").split()]
    assert shown
    assert all((a["title"] == "none") is ("short" not in (a["class"] or "").split()) for a in shown)


def test_pictures_and_films_are_shown_from_where_they_lie(tmp_path: Path) -> None:
    """A picture beside the page is in it and a link to itself; a film has its poster, if there is one."""
    runs = replace(synthetic_runs("mpvi", 0.7), folder=tmp_path / "runs")
    name = next(iter(runs.results)).name
    for file in (f"pictures/{name}.png", f"videos/{name}.mp4", f"videos/{name}.poster.jpg"):
        (tmp_path / "runs" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "runs" / file).write_bytes(b"x")
    page = Tags(page_of([runs], page=tmp_path / "page.html"))
    assert [a["src"] for tag, a in page.tags if tag == "img"] == [f"runs/pictures/{name}.png"]
    assert f"runs/pictures/{name}.png" in [a.get("href") for tag, a in page.tags if tag == "a"]
    film = next(a for tag, a in page.tags if tag == "video")
    assert (film["src"], film["poster"]) == (f"runs/videos/{name}.mp4", f"runs/videos/{name}.poster.jpg")


def test_wide_tables_can_be_scrolled_by_keys_and_show_that() -> None:
    """Each is an element that takes the keyboard, with a bar and a shadow where it goes on."""
    page = Tags(page_of(two()))
    wide = [a for _, a in page.tags if a.get("class") == "scroll"]
    assert len(wide) == sum(tag == "table" for tag, _ in page.tags)
    assert all(a.get("tabindex") == "0" for a in wide)
    rule = re.search(r"\.scroll \{(.*?)\}", page.inside["style"][0], re.DOTALL)
    assert rule is not None
    assert all(word in rule[1] for word in ("overflow-x", "scrollbar-color", "var(--shade)"))
