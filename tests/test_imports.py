"""The rules of import that keep the parts apart."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import mpvi_bt
from mpvi_bt.robot.robots import ROBOTS

PACKAGE = Path(mpvi_bt.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# What stands above what. A part may import parts of lower rank and itself; parts of one rank do not know each other.
RANKS = [
    {"errors"},
    {"yaml_reader", "compiled", "import_paths"},
    {"file_kinds"},
    {"robot", "paths", "marked_yaml", "writing", "proxies"},
    {"extras"},
    {"language", "rules"},
    {"goals", "perception", "shapes"},
    {"plan"},
    {"scene"},
    {"navigation", "manipulation/stance", "completion", "remote", "sim"},
    {"manipulation/motion"},
    {"manipulation/skills"},
    {"manipulation/policies"},
    {"manipulation"},
    {"behaviors"},
    {"tree", "testing"},
    {"drawing", "btcpp"},
    {"trace"},
    {"executive", "testing"},
    {"suite"},
    {"report", "maniskill"},
    {"api"},
    {"cli"},
]
RANK = {part: rank for rank, parts in enumerate(RANKS) for part in parts}
# Protocols, plain data and the check of it that modules of lower rank may share with the behaviors that use them.
SHARED = {"mpvi_bt.behaviors.protocols", "mpvi_bt.behaviors.chunk"}

# Another simulator's env of our tasks lies in sim with what it builds, and knows tasks and instances: it stands above.
MANISKILL = {f"sim/{path.name}" for path in (PACKAGE / "sim").glob("maniskill*.py")}

# Where a robot stands in if none is named, and what is about one robot; all else asks the robot that is there.
ROBOTS_OWN = {
    "sim/world.py",
    "sim/robot.py",
    "sim/maniskill_agent.py",
    "sim/maniskill_drives.py",
    "sim/maniskill_fetch.py",
    "completion/visual.py",
    "suite/instances.py",
    "suite/simulators.py",
    "suite/served.py",
}

ONLY_IN = {
    "sapien": {"sim", "maniskill"},
    "mani_skill": MANISKILL,
    "gymnasium": MANISKILL,
    "py_trees": {"behaviors", "tree", "executive"},
    "torch": {*MANISKILL, "perception/grounding_dino.py"},
    "transformers": {"perception/grounding_dino.py"},
    "rerun": {"executive/rerun_log.py"},
    "ray": {"suite/ray_engine.py"},
    "pandas": {"suite/dataset_files.py"},
    "openai": {"language/openai.py"},
    "httpx2": {"language/openai.py"},
    "xllamacpp": {"language/llama_server.py"},
    "vla_eval": {"suite/vla_eval_benchmark.py", "suite/vla_eval_server.py"},
}
DISTRIBUTION = {
    "yaml": "pyyaml",
    "pydantic_core": "pydantic",
    "cv2": "sapien",
    "imageio_ffmpeg": "imageio-ffmpeg",
    "rerun": "rerun-sdk",
    "vla_eval": "vla-eval",
}
HEAVY = (
    *("numpy", "sapien", "torch", "pydantic", "numba", "scipy", "yaml", "py_trees", "mani_skill"),
    *(
        "msgpack",
        "websockets",
        "transformers",
        "rerun",
        "pandas",
        "pyarrow",
        "openai",
        "httpx2",
        "ray",
        "vla_eval",
        "xllamacpp",
    ),
)


def part_of(path: Path) -> str:
    """The folder or module under the package that a file belongs to: "sim", "manipulation/skills" or "maniskill"."""
    within = path.relative_to(PACKAGE)
    if within.as_posix() in MANISKILL:
        return "maniskill"
    room = "/".join(within.parts[:2])
    return room if room in RANK else within.parts[0].removesuffix(".py")


def imports(path: Path) -> Iterator[str]:
    """Full names of the modules that a file imports anywhere, at the top or inside a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            assert node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def of_ours(path: Path) -> Iterator[tuple[str, str]]:
    """(part, full name) of each import of our own modules."""
    for name in imports(path):
        if name.startswith("mpvi_bt."):
            folders = name.split(".")[1:3]
            rooms = ["maniskill" if name.startswith("mpvi_bt.sim.maniskill") else "/".join(folders), folders[0]]
            if part := next((room for room in rooms if room in RANK), None):
                yield part, name


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_import_runs_back_up(path: Path) -> None:
    """A module imports only its own part and parts that stand below it."""
    own = part_of(path)
    if own == "__init__":
        return
    wrong = [
        name
        for part, name in of_ours(path)
        if part != own and RANK[part] >= RANK[own] and not any(name.startswith(f"{shared}.") for shared in SHARED)
    ]
    assert not wrong, f"{own} may not import {wrong}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_heavy_libraries_stay_in_their_place(path: Path) -> None:
    """Only sim imports sapien, only sim/maniskill.py ManiSkill, only what builds or ticks trees py_trees."""
    places = {part_of(path), path.relative_to(PACKAGE).as_posix()}
    for name in imports(path):
        allowed = ONLY_IN.get(name.split(".")[0])
        assert allowed is None or allowed & places, f"{name} is imported only in {sorted(allowed)}"


def test_no_module_knows_a_robot_by_heart() -> None:
    """Outside of robot a robot's own module is imported for a default, or by what is about that robot, alone."""
    robots = {f"mpvi_bt.robot.{name}{more}" for name in ROBOTS for more in ("", "_urdf")}
    knows = {
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if part_of(path) != "robot"
        for name in imports(path)
        if name in robots or name.rpartition(".")[0] in robots
    }
    assert knows == ROBOTS_OWN


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_every_part_has_a_rank(path: Path) -> None:
    """A new folder or top module must take its place in the order, or the laws above would not see it."""
    assert part_of(path) in {*RANK, "__init__"}


def test_every_library_is_declared() -> None:
    """What the package imports is Python's own, ours, or among the dependencies of pyproject.toml."""
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for lines in project["optional-dependencies"].values() for line in lines]
    declared = {re.split(r"[<>=\[]", line)[0].lower() for line in project["dependencies"] + extras}
    used = {name.split(".")[0] for path in MODULES for name in imports(path)} - sys.stdlib_module_names - {"mpvi_bt"}
    assert {DISTRIBUTION.get(name, name) for name in used} <= declared


@pytest.mark.parametrize(
    "statement", ["import mpvi_bt", "from mpvi_bt.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass"]
)
def test_nothing_heavy_loads_before_it_is_used(statement: str) -> None:
    """Neither `import mpvi_bt` nor `mpvi --help` loads a heavy library."""
    code = f"import sys\n{statement}\nprint('LOADED', [m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED []"
