"""`mpvi doctor`: check this machine, and print a command for each problem."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import click

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.drawing.colors import wants_color
from mpvi_bt.executive.drawing.terminal import draw, results, tell
from mpvi_bt.executive.language.endpoint import BASE_URL, EXPOSED, base_url
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.proxies import is_this_machine
from mpvi_bt.ground.version import __version__

PROBE_LIMIT_S = 120.0  # with stock shaders the first picture takes half a minute on a busy machine
APT_LIBRARIES = "libx11-6 libgl1 libglib2.0-0 libvulkan1"


@dataclass(frozen=True)
class Check:
    """One thing that was tried.

    Attributes:
        name: Such as "rendering".
        ok: Whether it works.
        core: Whether an episode needs it; what is not core is an extra.
        found: What is there, or what went wrong.
        mend: The command that mends it; "" where it works.
    """

    name: str
    ok: bool
    core: bool
    found: str
    mend: str = ""


def examine() -> list[Check]:
    """Try everything; never raises."""
    return [
        _python(),
        _guarded("data", True, "pip install --force-reinstall mpvi_bt", _data),
        _guarded("goals", True, "pip install 'bddl>=3.6,<4'", _goals),
        _physics(),
        _rendering(),
        _guarded("video", False, "pip install imageio-ffmpeg", _video),
        _extra("live pages", "starlette", "live"),
        _extra("torch", "torch", "maniskill"),
        _extra("maniskill", "mani_skill", "maniskill"),
        _extra("detector", "transformers", "grounding-dino"),
        _extra("recording", "rerun-sdk", "rerun"),
        _extra("mcap", "mcap-ros2-support", "mcap"),
        _extra("profile", "pyinstrument", "profile"),
        _guarded("ros2", False, install("ros2"), _ros2),
        _extra("language", "openai", "openai"),
        _key("OPENAI_API_KEY"),
        _guarded("endpoint", False, "export OPENAI_BASE_URL=http://HOST:PORT/v1", endpoint),
    ]


@click.command()
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object.")
def doctor(as_json: bool) -> int:
    """Check this machine, and print a command for each problem.

    Exit code 0 where an episode can run, 3 where it cannot.
    """
    checks = examine()
    healthy = all(check.ok for check in checks if check.core)
    if as_json:
        machine = {"system": platform.platform(), "cpus": os.cpu_count(), "mpvi_bt": __version__}
        tell(json.dumps({"ok": healthy, "machine": machine, "checks": [asdict(c) for c in checks]}, indent=2))
    else:
        tell(f"mpvi_bt {__version__} on {platform.platform()}, {os.cpu_count()} CPUs")
        for check in checks:
            _show(check)
        tell("Episodes can run here." if healthy else "Episodes cannot run here yet.")
    return 0 if healthy else 3


def _show(check: Check) -> None:
    word, color = ("ok", "green") if check.ok else ("missing", "red") if check.core else ("missing", "yellow")
    word = f"{word:8}"
    word = click.style(word, fg=color) if wants_color(results()) else word
    draw(results(), f"  {word} {check.name:10} {one_line(check.found)}\n")
    if check.mend:
        tell(f"{'':22}-> {check.mend}")


def _mend(target: str, otherwise: str) -> str:
    """`make TARGET` in a checkout, which has a Makefile; else the command itself."""
    root = paths.shipped()
    return f"make -C {root} {target}" if (root / "Makefile").is_file() else otherwise


def _guarded(name: str, core: bool, mend: str, look: Callable[[], str]) -> Check:
    """The check made by `look`, which returns its finding or raises."""
    try:
        return Check(name, True, core, look())
    except UserError as error:  # only settings can be wrong here
        return Check(name, False, core, str(error), "unset MPVI_PATH, or mend it")
    except Exception as error:  # whatever is broken here is the finding
        return Check(name, False, core, f"{error}" or type(error).__name__, mend)


def _python() -> Check:
    ok = sys.version_info >= (3, 11)
    return Check("python", ok, True, platform.python_version(), "" if ok else "sudo apt-get install python3.11-venv")


def _data() -> str:
    counts = {folder: len(paths.names(folder)) for folder in ("tasks", "skills", "trees")}
    if not counts["tasks"]:
        raise MpviError(f"no tasks in {', '.join(map(str, paths.roots()))}")
    return ", ".join(f"{count} {folder}" for folder, count in counts.items()) + f" in {paths.shipped()}"


def _goals() -> str:
    spec = importlib.util.find_spec("bddl")  # finds it without importing it, which would take long
    if spec is None or spec.origin is None:
        raise MpviError("the bddl package, which has the goals, is not installed")
    definitions = Path(spec.origin).parent / "activity_definitions"
    count = sum(1 for _ in definitions.glob("*/problem0.bddl"))
    if not count:
        raise MpviError(f"no problem files in {definitions}")
    return f"bddl {importlib.metadata.version('bddl')}, {count} activities"


def _physics() -> Check:
    if importlib.util.find_spec("sapien") is None:
        return Check("physics", False, True, "SAPIEN is not installed", "pip install 'sapien>=3.0.3,<4'")
    return _probe("physics", "physics", True, _mend("setup", f"sudo apt-get install {APT_LIBRARIES}"))


def _video() -> str:
    import imageio_ffmpeg

    return f"ffmpeg {imageio_ffmpeg.get_ffmpeg_version()}"


def _rendering() -> Check:
    mend = _mend("setup", "sudo apt-get install libvulkan1 mesa-vulkan-drivers  # Mesa >= 24.3")
    device = _probe("rendering", "vulkan", False, mend)
    if not device.ok:
        return device
    drawn = _probe("rendering", "picture", False, mend)
    return Check("rendering", drawn.ok, False, f"{device.found}: {drawn.found}", drawn.mend)


def _ros2() -> str:
    from mpvi_bt.runs.ros2.ros_packages import require_ros

    require_ros()
    return "rclpy and its messages can be loaded"


def _extra(name: str, module: str, extra: str) -> Check:
    try:
        return Check(name, True, False, f"{module} {importlib.metadata.version(module)}")
    except importlib.metadata.PackageNotFoundError:
        return Check(name, False, False, "optional", install(extra))


def _key(variable: str) -> Check:
    ok = bool(os.environ.get(variable))
    return Check(
        "key",
        ok,
        False,
        f"{variable} is {'set' if ok else 'not set; optional'}",
        "" if ok else f"export {variable}=...",
    )


def endpoint() -> str:
    """The host of the language models, without credentials."""
    if not os.environ.get(BASE_URL):
        return f"{BASE_URL} is not set; language models are OpenAI's own"
    try:
        parts = base_url(os.environ)
    except UserError as error:
        raise MpviError(str(error)) from None  # it is this variable that is to be mended
    exposed = parts.scheme == "http" and not is_this_machine(parts.geturl())
    return f"{BASE_URL} is set: {parts.hostname}" + (f"; {EXPOSED}" if exposed else "")


def _probe(name: str, probe: str, core: bool, mend: str) -> Check:
    """Run one of `mpvi_bt.house.sim.probe` in a process of its own, which may crash or hang."""
    command = [sys.executable, "-m", "mpvi_bt.house.sim.probe", probe]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Check(name, False, core, f"no answer within {PROBE_LIMIT_S:.0f} s", mend)
    except OSError as error:
        return Check(name, False, core, str(error), mend)
    if done.returncode == 0:
        return Check(name, True, core, done.stdout.strip())
    said = done.stderr.strip().splitlines()
    return Check(name, False, core, said[-1] if said else f"ended with code {done.returncode}", mend)
