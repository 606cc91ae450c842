"""Laws of the recording for the rerun viewer, read back with its own SDK."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.loop import Watcher, World, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.runs.recording.rerun_log import RerunLog, require_sdk
from mpvi_bt.runs.recording.search_view import Window
from mpvi_bt.testing import scripted_context
from tests.conftest import Shell
from tests.search_views import MadeUpSearch, find, searching
from tests.test_recorders import SPEC, Interrupting, VisibleWorld, watch
from tests.without_library import without

pytest.importorskip("rerun", reason="needs the extra 'rerun' (0.7 GB)")

Row = dict[str, Any]


def rows(file: Path) -> dict[str, list[Row]]:
    """Entity path to the rows that were logged there, of a recording that may have no index."""
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of one that was not closed
        chunks = RrdReader(file).stream().to_chunks()
    logged: dict[str, list[Row]] = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        columns = {name: _plain(batch.column(name)) for name in batch.schema.names}
        logged.setdefault(chunk.entity_path, []).extend(
            {name: values[i] for name, values in columns.items()} for i in range(batch.num_rows)
        )
    return logged


def _plain(column: Any) -> list[Any]:
    """Its values; times as whole nanoseconds, of which Python's own types have none."""
    is_time = str(column.type).startswith(("timestamp", "duration"))
    return list((column.cast("int64") if is_time else column).to_pylist())


def command(*args: str) -> subprocess.CompletedProcess[str]:
    """Run the SDK's own tool."""
    code = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    return subprocess.run([sys.executable, "-c", code, *args], capture_output=True, text=True, timeout=60, check=False)


def test_a_recording_tells_of_every_frame(tmp_path: Path) -> None:
    """Steps and simulated times, the head's picture, what was detected, the way, and the map where it changed."""
    file, search = tmp_path / "new" / "run.rrd", searching()
    watch(VisibleWorld(), RerunLog(file, search.map, "a title", search, frames_per_s=5))
    logged = rows(file)
    steps = [row["step"] for row in logged["/world/robot"] if row.get("step") is not None]
    assert steps == list(range(0, 61, 6))
    times = [row["simulated time"] * 1e-9 for row in logged["/world/robot"] if row.get("step") is not None]
    assert times == pytest.approx([step / 30 for step in steps])
    boxes = logged["/world/head/detections"][0]
    assert boxes["Boxes2D:labels"] == ["can 0.90"]
    assert boxes["Boxes2D:centers"] == [pytest.approx([120, 130])]
    assert logged["/world/found"][0]["Boxes3D:labels"] == ["can 1.00"]
    assert logged["/world/found"][0]["Boxes3D:centers"] == [pytest.approx([3, 3, 0.06])]
    assert {"/map/floor", "/map/seen", "/map/frontier", "/map/path", "/map/goal", "/tree"} <= set(logged)
    assert len(logged["/map/seen"]) == 1
    assert SPEC.name in logged["/tree"][0]["TextDocument:text"][0]
    assert command("rrd", "verify", str(file)).returncode == 0


def test_a_run_that_searches_nothing_is_logged_too(tmp_path: Path) -> None:
    """With the map that it was given, and what the head sees."""
    file, world = tmp_path / "run.rrd", VisibleWorld()
    watch(world, RerunLog(file, MadeUpSearch().map))
    logged = rows(file)
    assert {"/map/floor", "/world/head", "/world/robot", "/tree"} <= set(logged)
    assert not {"/map/seen", "/world/found"} & set(logged)


def test_what_is_on_the_map_stays_in_place_where_the_map_grows(tmp_path: Path) -> None:
    """The images show more cells then, and what has a place on them is logged anew."""
    grid = OccupancyMap(np.ones((400, 400), bool), np.full((400, 400), -1, np.int16), (), 0.05, np.full(2, -10.0))
    known = np.zeros((400, 400), bool)
    search = MadeUpSearch(grid, known, known, known, entries=[find("can", 0.5, 0.5)])
    file = tmp_path / "run.rrd"
    expected: list[list[int]] = []

    class Growing(Watcher):
        """Learns of more floor with each second."""

        def __init__(self) -> None:
            self.window = Window()

        def step(self, tree: Tree, world: World) -> None:
            """Open a larger square."""
            half = 30 + 60 * int(world.time_s)
            known[200 - half : 200 + half, 200 - half : 200 + half] = True
            grid.occupied[known] = False
            rows, columns = self.window.of(search)
            place = [210 - columns.start, rows.stop - 210]
            if world.steps % 6 == 0 and (not expected or expected[-1] != place):
                expected.append(place)

    watch(VisibleWorld(), Growing(), RerunLog(file, grid, search=search))
    logged = [row["Points2D:positions"][0] for row in rows(file)["/map/found"]]
    assert len(expected) > 1
    assert logged == [pytest.approx(place) for place in expected]


def test_what_fails_is_logged_with_its_reason_when_it_does(tmp_path: Path) -> None:
    """Whether or not a frame is due then; and how it all ended."""
    file, world = tmp_path / "run.rrd", VisibleWorld()
    context = scripted_context(world, load_skills(), {}, {})
    outcome = run_episode(Tree(SPEC), world, context, [RerunLog(file, MadeUpSearch().map, frames_per_s=0.1)], 60.0)
    failures = outcome.log.failures
    assert failures
    told = [(row["step"], row["TextLog:text"][0]) for row in rows(file)["/reasons"]]
    for failure in failures:
        assert any(failure.path in text and failure.reason in text and step == round(failure.time_s * 30)
                   for step, text in told), (failure, told)  # fmt: skip
    assert outcome.told(SPEC) in told[-1][1]


def test_after_ctrl_c_the_recording_is_whole(tmp_path: Path) -> None:
    """With its index."""
    file = tmp_path / "run.rrd"
    with pytest.raises(KeyboardInterrupt):
        watch(VisibleWorld(), RerunLog(file, MadeUpSearch().map), Interrupting())
    assert command("rrd", "verify", str(file)).returncode == 0
    assert "interrupted" in rows(file)["/reasons"][-1]["TextLog:text"][0]


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The recording of a run that was killed, and the last step of which the run said that it is logged."""
    file, root = tmp_path_factory.mktemp("killed") / "run.rrd", Path(__file__).parent.parent
    child = subprocess.Popen(
        [sys.executable, "-m", "tests.rerun_child", str(file)], cwd=root, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    for line in child.stdout:
        last = int(line)
        if last >= 120:
            os.kill(child.pid, signal.SIGKILL)
            break
    last = int(([line, *child.stdout.readlines()])[-1])
    assert child.wait() == -signal.SIGKILL
    return file, last


def test_a_killed_run_can_be_read_up_to_its_last_frame(killed: tuple[Path, int], tmp_path: Path) -> None:
    """Of SIGKILL no process knows; all frames that were logged before are there, and the SDK's tool mends the file."""
    file, last = killed
    mended = tmp_path / "mended.rrd"
    assert command("rrd", "optimize", str(file), "-o", str(mended)).returncode == 0
    assert command("rrd", "verify", str(mended)).returncode == 0
    steps = sorted(row["step"] for row in rows(mended)["/world/robot"] if row.get("step") is not None)
    assert steps[: last // 6 + 1] == list(range(0, last + 1, 6))


def test_a_frame_that_is_torn_costs_nothing_but_itself(killed: tuple[Path, int], tmp_path: Path) -> None:
    """What stands before the place where the file breaks off can be read."""
    file, last = killed
    data, torn, mended = file.read_bytes(), tmp_path / "torn.rrd", tmp_path / "mended.rrd"
    torn.write_bytes(data[: len(data) * 9 // 10])
    assert command("rrd", "optimize", str(torn), "-o", str(mended)).returncode == 0
    steps = sorted(row["step"] for row in rows(mended)["/world/robot"] if row.get("step") is not None)
    assert steps == list(range(0, steps[-1] + 1, 6))
    assert steps[-1] > last / 2


def test_a_file_that_cannot_be_written_is_a_user_error(tmp_path: Path) -> None:
    """Said before the episode begins, with the path."""
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"run\.rrd"):
        watch(VisibleWorld(), RerunLog(tmp_path / "file" / "run.rrd", MadeUpSearch().map))


def test_a_full_disk_is_a_backend_error() -> None:
    """Which says of which file."""
    with pytest.raises(BackendError, match=r"/dev/full: .*[Nn]o space left"):
        watch(VisibleWorld(), RerunLog("/dev/full", MadeUpSearch().map))


def test_a_disk_that_fills_up_ends_the_run_and_nothing_waits(tmp_path: Path) -> None:
    """The SDK by itself would wait at the exit for what can no longer be written."""
    file = tmp_path / "run.rrd"
    done = subprocess.run(
        [sys.executable, "-m", "tests.rerun_child", str(file), "200000"],
        cwd=Path(__file__).parent.parent, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"BackendError: {file}: rerun cannot write the recording" in done.stderr


def test_without_the_sdk_there_is_a_line_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, mpvi: Shell, tmp_path: Path
) -> None:
    """Before anything is set up; and nothing but `--rerun` needs it."""
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.chdir(tmp_path)  # where the command runs; the clone is named by its path there
    with pytest.raises(UserError, match=re.escape(install("rerun"))):
        require_sdk()
    hidden = without("rerun", tmp_path)
    done = mpvi("run", "picking_up_trash", "--rerun", "run.rrd", PYTHONPATH=hidden)
    assert done.returncode == 2
    assert done.stderr == f"mpvi: --rerun needs the SDK of rerun, which is not installed: {install('rerun')}\n"
    assert not (tmp_path / "run.rrd").exists()
    assert mpvi("run", "--dry", "--tree", "hello", PYTHONPATH=hidden).returncode == 0
