"""What ships: the wheel holds the data, and works from where it is installed."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the wheel was unpacked into, as pip would."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_the_wheel_holds_every_data_file(installed: Path) -> None:
    """All data of the checkout, such as its trees, is in the wheel, and its types are marked."""
    ours = {
        p.relative_to(ROOT)
        for name in ("trees", "skills", "tasks", "policies", "robots", "bridges")
        for p in (ROOT / name).rglob("*")
        if p.is_file()
    }
    data = installed / "mpvi_bt" / "_data"
    assert {p.relative_to(data) for p in data.rglob("*") if p.is_file()} == ours
    assert (installed / "mpvi_bt" / "py.typed").is_file()


def test_the_wheel_holds_every_file_of_the_package(installed: Path) -> None:
    """What lies beside the modules, such as the parts of the page, ships with them."""
    package = ROOT / "mpvi_bt"
    ours = {p.relative_to(package) for p in package.rglob("*") if p.is_file() and "__pycache__" not in p.parts}
    shipped = {p.relative_to(installed / "mpvi_bt") for p in (installed / "mpvi_bt").rglob("*") if p.is_file()}
    assert {Path("executive/trace/page/page.html"), Path("executive/trace/page/page.js")} <= ours <= shipped


def test_data_is_found_in_an_installed_wheel(installed: Path, tmp_path: Path) -> None:
    """An installed package lists the tasks that it holds itself, not the checkout's."""
    code = (
        "from mpvi_bt.ground import paths; print(paths.shipped()); "
        "from mpvi_bt.apps.cli import main; main(['list', 'tasks'])"
    )
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    folder, *tasks = done.stdout.splitlines()
    assert Path(folder) == installed / "mpvi_bt" / "_data"
    assert any(line.startswith("picking_up_trash") for line in tasks)


@pytest.mark.parametrize("target", ["demo", "test"])
def test_the_two_commands_set_up_what_they_need(target: str) -> None:
    """`make demo` and `make test` begin with the system packages and the environment, whatever is there already."""
    done = subprocess.run(
        ["make", "--dry-run", "VENV=no-such-folder", target], cwd=ROOT, capture_output=True, text=True, check=True
    )
    order = [done.stdout.index(step) for step in ("scripts/system-packages.sh", "-m venv", "-m pip install")]
    assert order == sorted(order)


def test_set_up_changes_nothing_where_all_is_there() -> None:
    """On a machine that is set up, the script for system packages installs nothing and says nothing."""
    done = subprocess.run(
        [ROOT / "scripts" / "system-packages.sh"], capture_output=True, text=True, check=True, timeout=10
    )
    assert (done.stdout, done.stderr) == ("", "")
