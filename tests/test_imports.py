"""The rules of import that keep the parts apart."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from mpvi_bt.ground.robot.robots import ROBOTS
from tests.rooms import MODULES, PACKAGE, PAGE, RANK, imports, page, parsed, room_of, rooms_imported

# Where a robot stands in if none is named, and what is about one robot; all else asks the robot that is there.
ROBOTS_OWN = {
    "house/sim/world.py",
    "house/sim/sim_robot.py",
    "house/maniskill/agent.py",
    "house/maniskill/drive_tensors.py",
    "house/maniskill/fetch_agent.py",
    "hands/learned/mirroring.py",
    "house/instances/instances.py",
}

ROS_MESSAGES = (
    *("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "rosgraph_msgs", "sensor_msgs", "std_msgs"),
    *("std_srvs", "trajectory_msgs", "visualization_msgs"),
)
ONLY_IN = {
    "sapien": {"house/sim", "house/maniskill", "house/things/mesh_urdf.py"},
    "mani_skill": {"house/maniskill"},
    "gymnasium": {"house/maniskill"},
    "py_trees": {"executive/behaviors", "executive/tree", "executive/ticking", "runs/recording"},
    "torch": {
        *("house/maniskill", "finding/perception/grounding_dino.py", "ground/torch_training.py"),
        "executive/remote/lerobot_policy.py",
    },
    "lerobot": {"executive/remote/lerobot_policy.py"},
    "transformers": {"finding/perception/grounding_dino.py"},
    "grpc": {"executive/remote/lerobot_wire.py"},
    "zmq": {"executive/remote/groot_wire.py"},
    "rerun": {"runs/recording/rerun_log.py"},
    "mcap_ros2": {"runs/recording/mcap_log.py"},
    "pyinstrument": {"runs/recording/profile.py"},
    "ray": {"runs/suite/ray_engine.py"},
    "pandas": {"runs/datasets/parquet.py"},
    "openai": {"executive/language/openai.py"},
    "httpx2": {"executive/language/openai.py"},
    "xllamacpp": {"executive/language/llama_server.py"},
    "mcp": {"apps/mcp_server"},
    "mcp_types": {"apps/mcp_server"},
    "starlette": {"apps/watch", "apps/mcp_server"},
    "uvicorn": {"apps/watch"},
    "rclpy": {"runs/ros2", "apps/cli/ros2_house.py"},
    **{name: {"runs/ros2"} for name in ROS_MESSAGES},
    "vla_eval": {"runs/serving/vla_eval_benchmark.py", "runs/serving/vla_eval_server.py"},
}
DISTRIBUTION = {
    "yaml": "pyyaml",
    "pydantic_core": "pydantic",
    "PIL": "pillow",
    "cv2": "sapien",
    "imageio_ffmpeg": "imageio-ffmpeg",
    "mcp_types": "mcp",
    "rerun": "rerun-sdk",
    "mcap_ros2": "mcap-ros2-support",
    "unified_planning": "unified-planning",
    "zmq": "pyzmq",
    "grpc": "grpcio",
    "vla_eval": "vla-eval",
    **{name: f"ros-{name.replace('_', '-')}" for name in ("rclpy", *ROS_MESSAGES)},
}
HEAVY = (
    *("numpy", "sapien", "torch", "pydantic", "numba", "scipy", "yaml", "py_trees", "mani_skill"),
    *(
        "msgpack",
        "websockets",
        "transformers",
        "rerun",
        "mcap_ros2",
        "pyinstrument",
        "pandas",
        "pyarrow",
        "openai",
        "httpx2",
        "mcp",
        "ray",
        "starlette",
        "uvicorn",
        "rclpy",
        "vla_eval",
        "xllamacpp",
        "lerobot",
        "zmq",
        "grpc",
    ),
)


def test_no_two_files_of_the_package_have_one_name() -> None:
    """A trace or an editor's tab that names a file leaves no doubt which it is."""
    names = Counter(path.name for path in MODULES if path.stem not in ("__init__", "__main__"))
    assert [name for name, files in names.items() if files > 1] == []


def test_no_two_classes_of_the_package_have_one_name() -> None:
    """A search for a class, or its name in a message, leads to one place."""
    nodes = (node for path in MODULES for node in ast.walk(parsed(path)))
    names = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    assert [name for name, classes in names.items() if classes > 1] == []


def test_no_import_runs_back_up() -> None:
    """A module imports only its own room, rooms below it in its wing, and wings below that one."""
    wrong = [
        f"{_named(path)} may not import {room}"
        for path in MODULES
        if (own := room_of(path))
        for room in sorted({*rooms_imported(path)} - {own})
        if RANK[room] >= RANK[own]
    ]
    assert not wrong


def test_no_files_import_each_other_in_a_circle() -> None:
    """Not even for types, or within functions: what one file needs of another can be read first."""
    named = {".".join(("mpvi_bt", *path.relative_to(PACKAGE).with_suffix("").parts)): path for path in MODULES}
    needs = {
        name: {known for found in imports(path) for known in (found, found.rpartition(".")[0]) if known in named}
        - {name}
        for name, path in named.items()
    }
    tuple(TopologicalSorter(needs).static_order())  # raises CycleError, which names the files


def test_heavy_libraries_stay_in_their_place() -> None:
    """Only sim imports sapien, only maniskill ManiSkill, only what builds or ticks trees py_trees."""
    wrong = [
        f"{_named(path)}: {name} is imported only in {sorted(allowed)}"
        for path in MODULES
        for name in imports(path)
        if (allowed := ONLY_IN.get(name.split(".")[0])) and not allowed & {room_of(path), _named(path)}
    ]
    assert not wrong


def test_no_module_knows_a_robot_by_heart() -> None:
    """Outside of its room a robot's own module is imported for a default, or by what is about that robot, alone."""
    robots = {f"mpvi_bt.hands.robots.{name}{more}" for name in ROBOTS for more in ("", "_urdf")}
    knows = {
        _named(path)
        for path in MODULES
        if room_of(path) != "hands/robots"
        for name in imports(path)
        if name in robots or name.rpartition(".")[0] in robots
    }
    assert knows == ROBOTS_OWN


def test_every_room_has_a_rank() -> None:
    """A new room or lone module must take its place in the order, or the laws above would not see it."""
    assert {room_of(path) for path in MODULES} - {*RANK, ""} == set()


def test_the_page_shows_the_rooms_as_they_are() -> None:
    """The table of rooms in CONTRIBUTING.md is what `python -m tests.rooms` draws."""
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m tests.rooms"


def test_no_test_imports_a_benchmark() -> None:
    """What tests build on is in the package or beside them; benchmarks have tests of their own in benchmarks/tests."""
    own = (PACKAGE.parent / "tests").rglob("*.py")
    assert not [path.name for path in own if any(name.startswith("benchmarks") for name in imports(path))]


def test_every_library_is_declared() -> None:
    """What the package imports is Python's own, ours, or among the dependencies of pyproject.toml."""
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for lines in project["optional-dependencies"].values() for line in lines]
    declared = {re.split(r"[<>=\[]", line)[0].lower() for line in project["dependencies"] + extras}
    used = {name.split(".")[0] for path in MODULES for name in imports(path)} - sys.stdlib_module_names - {"mpvi_bt"}
    assert {DISTRIBUTION.get(name, name) for name in used} <= declared


@pytest.mark.parametrize(
    "statement", ["import mpvi_bt", "from mpvi_bt.apps.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass"]
)
def test_nothing_heavy_loads_before_it_is_used(statement: str) -> None:
    """Neither `import mpvi_bt` nor `mpvi --help` loads a heavy library."""
    code = f"import sys\n{statement}\nprint('LOADED', [m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "LOADED []"


def _named(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()
