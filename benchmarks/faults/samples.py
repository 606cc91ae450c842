"""Good files of every kind that is read, and what reads them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.mutations import BYTES, TEXT, Mutation, aliases, of_arrays, of_json, of_lines, of_yaml
from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EpisodeConfig

Read = Callable[[Path], str | None]  # a complaint; or it raises one
CHAT = "cup"


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        name: For the table.
        files: Good ones, by where they have to lie.
        read: What reads one.
        mutations: Ways to break it.
        form: What a file has to be: "yaml" one document that is strict, as files of people are, "json" one of machines,
            "lines" a JSON object a line, "digest" JSON that knows its own sum, "arrays" an archive of arrays; "": any
            text.
    """

    name: str
    files: dict[str, bytes]
    read: Read
    mutations: Sequence[Mutation]
    form: str = ""


def kinds(folder: Path) -> list[Kind]:
    """Every kind of file; those that no repository has are made in a folder."""
    return [*_of_the_repository(folder), *_of_runs(folder)]


def _of_the_repository(folder: Path) -> Iterable[Kind]:
    from mpvi_bt.executive.btcpp.export import to_xml
    from mpvi_bt.executive.btcpp.importing import from_xml
    from mpvi_bt.executive.plan.schema import load_plan
    from mpvi_bt.executive.plan.skills import load_skill
    from mpvi_bt.executive.remote.dialect_settings import load_settings
    from mpvi_bt.executive.tree.compile import compile_plan
    from mpvi_bt.executive.tree.substitute import load_rules
    from mpvi_bt.executive.tree.yaml_io import load_tree
    from mpvi_bt.ground.marked_yaml import read_text
    from mpvi_bt.house.goals.problem import distributed
    from mpvi_bt.house.instances.tasks import read_task
    from mpvi_bt.house.layout.house import load_house
    from mpvi_bt.house.things.catalogue import load_catalogue
    from mpvi_bt.runs.choices.methods import load_method
    from mpvi_bt.runs.suite.suites import load_suite

    yaml = [*TEXT, of_yaml, of_yaml, of_yaml, aliases]
    loads: dict[str, tuple[str, Callable[[Path], Any]]] = {
        "tree": ("trees", load_tree),
        "skill": ("skills", load_skill),
        "task": ("tasks", read_task),
        "house": ("tasks/houses", load_house),
        "catalogue": ("tasks/catalogues", load_catalogue),
        "suite": ("tasks/suites", lambda path: load_suite(str(path))),
        "method": ("tasks/methods", lambda path: load_method(str(path))),
        "settings of a policy": ("policies", lambda path: load_settings(str(path))),
    }
    for name, (place, load) in loads.items():
        files = {f"{place}/{path.name}": path.read_bytes() for path in paths.files(place) if path.suffix == ".yaml"}
        small = sorted(files, key=lambda place: len(files[place]))[: 3 * len(files) // 5 + 1]  # large ones take long
        yield Kind(name, {place: files[place] for place in small}, checked(load), yaml, "yaml")
    plans = {f"tasks/plans/{path.name}": path.read_bytes() for path in paths.files("tasks/plans")}
    skills = _skills()
    yield Kind(
        "plan", plans, checked(lambda path: compile_plan(load_plan(path), skills)), [*TEXT, of_json, of_json], "yaml"
    )
    rules = b"substitute:\n  - nodes: '*/set'\n    fail: not_yet\n    times: 1\n  - nodes: drive\n    delay: 2\n"
    yield Kind("rules", {"rules.yaml": rules}, checked(load_rules), yaml, "yaml")
    problem = distributed()["picking_up_trash"].read_bytes()
    yield Kind("BDDL problem", {"problems/picking_up_trash/problem0.bddl": problem}, _checked_only, TEXT)
    spec = load_tree(next(path for path in paths.files("trees") if path.suffix == ".yaml"))
    xml = {"tree.xml": to_xml(spec).xml.encode()}
    yield Kind("BehaviorTree.CPP", xml, lambda path: quiet(from_xml(read_text(path), str(path))), TEXT)


def _of_runs(folder: Path) -> Iterable[Kind]:
    from mpvi_bt.executive.language.budget import Budget
    from mpvi_bt.executive.language.chat import Message
    from mpvi_bt.executive.language.exchanges import KeptModel
    from mpvi_bt.executive.language.scripted_model import ScriptedChatModel
    from mpvi_bt.executive.monitors.calibration import SIGNALS, Calibration, SkillThresholds, load_calibration
    from mpvi_bt.executive.remote.prompts import read_prompts
    from mpvi_bt.executive.trace.diff import diff, difference_text
    from mpvi_bt.executive.trace.explain import explain
    from mpvi_bt.executive.trace.html import trace_page
    from mpvi_bt.executive.trace.read import read_trace
    from mpvi_bt.hands.learned.network import Weights
    from mpvi_bt.hands.learned.policy import WEIGHTS
    from mpvi_bt.hands.learned.training_set import read_frames
    from mpvi_bt.house.things.mesh_file import read_mesh
    from mpvi_bt.runs.disturbances.latency import read_latencies
    from mpvi_bt.runs.episode.result import read_result, write_result
    from mpvi_bt.runs.episode.saved_episode import load_saved
    from mpvi_bt.runs.suite.at_work import FILE, note, read
    from mpvi_bt.runs.suite.at_work import AtWork as Work
    from mpvi_bt.runs.suite.manifest import make_manifest, read_manifest
    from mpvi_bt.runs.suite.store import Fault, Store
    from tests.fake_episodes import fake_result

    folder.mkdir(parents=True, exist_ok=True)
    json_ = [*TEXT, of_json, of_json, of_json]
    config = EpisodeConfig("picking_up_trash")

    trace = _trace(folder / "trace.jsonl")

    def follow(path: Path) -> None:
        read_ = read_trace(path)
        explain(read_)
        trace_page(read_)
        difference_text(diff(read_, read_))

    yield Kind("trace", {"trace.jsonl": trace}, lambda path: quiet(follow(path)), [*TEXT, of_lines, of_lines], "lines")

    write_result(folder / "result.json", fake_result(config))
    result = {"json/picking_up_trash_0_0.json": (folder / "result.json").read_bytes()}
    yield Kind("result", result, lambda path: None if read_result(path) else f"{path}: no result", json_, "digest")

    mine = make_manifest("trash", [config])
    manifest = json.dumps(mine.model_dump()).encode()

    def claim(path: Path) -> None:
        if (kept := read_manifest(path.parent)) is not None:
            kept.episodes()
        mine.claim(path.parent)

    yield Kind("manifest", {"suite/manifest.json": manifest}, lambda path: quiet(claim(path)), json_, "json")

    yield Kind(
        "saved run", {"saved.json": _saved(folder)}, lambda path: quiet(_resumed(load_saved(path))), json_, "yaml"
    )

    bands: Any = {name: [0.5, 1.0, 2.0] for name in SIGNALS}
    known = Calibration(
        policy="reactive", robot="r1", alpha=0.1, skills={"pick": SkillThresholds(runs=40, thresholds=bands)}
    )

    def alarms(path: Path) -> None:
        load_calibration(path, "reactive", "r1").alarms("pick", 1, np.ones(len(SIGNALS)))

    calibration = known.model_dump_json(indent=1).encode()
    yield Kind("calibration", {"calibration.json": calibration}, lambda path: quiet(alarms(path)), json_, "yaml")

    weights = Weights.load(WEIGHTS)
    dataclasses.replace(weights, skills={"pick": weights.skills["pick"]}).save(folder / "w.npz")
    whole = {"weights.npz": (folder / "w.npz").read_bytes()}
    arrays = [*BYTES, of_arrays, of_arrays]
    yield Kind("weights", whole, lambda path: quiet(Weights.load(path)), arrays, "arrays")

    def frames(path: Path) -> str | None:
        said: list[str] = []
        try:
            read_frames(path.parent.parent, "pick", said.append)
        except UserError as error:
            return said[0] if said else str(error)
        return said[0] if said else None

    yield Kind("demonstration", {"shown/pick/1.npz": _demonstration(folder)}, frames, arrays, "arrays")

    asked = [Message("user", CHAT)]
    KeptModel("m", "m", folder / "kept", ScriptedChatModel(["yes"])).ask(asked)
    exchange = next((folder / "kept").glob("*.json"))
    kept = {f"kept/{exchange.name}": exchange.read_bytes()}
    yield Kind(
        "kept answer", kept, lambda path: quiet(KeptModel("m", "m", path.parent, None).ask(asked)), json_, "json"
    )

    def spend(path: Path) -> None:
        budget = Budget("suite", 10, 1000, path)
        budget.begin()
        budget.end(1)

    yield Kind(
        "ledger", {"asked.json": b'{"calls": 3, "tokens": 70}\n'}, lambda path: quiet(spend(path)), json_, "json"
    )

    Store(folder / "s").write_fault(config, Fault("it broke", "Traceback", backend="server_closed"))
    fault = (folder / "s" / "faults" / f"{config.name}.json").read_bytes()

    def told(path: Path) -> str | None:
        return None if Store(path.parent.parent).fault(config) else f"{path}: no fault"

    yield Kind("fault", {f"faults/{config.name}.json": fault}, told, json_)

    note(folder, [Work(worker=1, method="", episode="e", since=1.0)])
    work = (folder / FILE).read_bytes()
    yield Kind("note of work", {FILE: work}, lambda path: None if read(path.parent) else f"{path}: none", json_, "json")

    times = b'{"policy": [0.31, 0.29, 0.5], "checker": [1.5]}\n'
    yield Kind(
        "measured times", {"times.json": times}, lambda path: quiet(read_latencies(f"policy=@{path}")), json_, "json"
    )
    prompts = b'{"picking_up_trash": "Pick up the trash.", "tidying_bedroom": {"prompt": "Tidy up."}}\n'
    yield Kind("prompts", {"prompts.json": prompts}, lambda path: quiet(read_prompts(path)), json_, "yaml")
    yield Kind("mesh", {"thing.obj": _mesh()}, lambda path: quiet(read_mesh(path)), TEXT)


def quiet(value: Any) -> None:
    """What reads a file raises its complaints."""


def checked(load: Callable[[Path], Any]) -> Read:
    """A reader that checks a file as `mpvi check` does, and loads it if nothing is wrong with it."""

    def read(path: Path) -> str | None:
        if complaint := _checked_only(path):
            return complaint
        load(path)
        return None

    return read


def _checked_only(path: Path) -> str | None:
    errors = [problem for problem in problems_in(str(path)) if problem.severity == "error"]
    return "\n".join(map(str, errors)) or None


def _skills() -> Any:
    from mpvi_bt.executive.plan.skills import load_skills

    return load_skills()


def _trace(path: Path) -> bytes:
    """Of an episode with a robot of numbers alone."""
    from mpvi_bt.executive.plan.planners import RecordedPlanner
    from mpvi_bt.executive.ticking.loop import run_episode
    from mpvi_bt.executive.tree.build import Tree
    from mpvi_bt.executive.tree.compile import compile_plan
    from mpvi_bt.runs.recording.recorder import Recorder
    from mpvi_bt.testing import KinematicWorld, scripted_context

    world, skills = KinematicWorld(), _skills()
    spec = compile_plan(RecordedPlanner().plan("picking_up_trash"), skills)
    context = scripted_context(world, skills, {"trash can": (1.0, 0.0), "can of soda": (0.0, 0.5)}, {})
    run_episode(Tree(spec), world, context, [Recorder(path)], max_time_s=6.0)
    return path.read_bytes()


def _saved(folder: Path) -> bytes:
    """Of a dry run that was stopped."""
    from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_tree, run_dry
    from mpvi_bt.executive.tree.yaml_io import parse_tree
    from mpvi_bt.runs.episode.saved_episode import Keeper
    from tests.test_saved import TREE

    config = EpisodeConfig("", seed=1, tree="t.yaml", saved=folder / "saved.json")
    tree, world = dry_tree(parse_tree(TREE)), EmptyWorld()
    run_dry(tree, stop=Keeper(lambda: tree.ticks >= 220, config, tree, world), world=world)
    return (folder / "saved.json").read_bytes()


def _resumed(saved: Any) -> None:
    """Go on with a saved run, a few steps: what it says of the tree is believed only now."""
    from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
    from mpvi_bt.runs.episode.prepare import prepare_saved

    prepared = prepare_saved(saved, saved.episode)
    assert prepared.saved is not None
    tree = dry_tree(prepared.spec, prepared.rules)
    begun = tree.ticks
    run_dry(tree, saved=prepared.saved.run, stop=lambda: tree.ticks > begun + 300)


def _demonstration(folder: Path) -> bytes:
    """A hand that closes once."""
    from mpvi_bt.hands.learned.demonstration import Demonstration
    from tests.layouts import ACTION_SIZE, LAYOUT

    n = 40
    action = np.zeros((n, ACTION_SIZE))
    action[:, LAYOUT.arm["right"]] = np.linspace(0, 1, n)[:, None]
    action[:, LAYOUT.gripper["right"]] = np.where(np.arange(n) < 20, 1.0, -1.0)
    shown = Demonstration(
        np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 7)), np.full((n,), 0.1), action,
        np.full((4, 128, 3), 0.5), np.minimum(np.arange(n) // 10, 3),
    )  # fmt: skip
    shown.save(folder / "d.npz")
    return (folder / "d.npz").read_bytes()


def _mesh() -> bytes:
    from mpvi_bt.house.things.mesh_file import MeshBody, mesh_text

    corners = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)])
    return mesh_text({"body": MeshBody(hulls=[corners])}).encode()
