"""The published openpi-client in an environment of its own: it pins numpy below 2, which mpvi_bt is above."""

from __future__ import annotations

import fcntl
import functools
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = "openpi-client==0.1.2"
_BESIDE = "typing_extensions"  # which it imports and does not ask for
_FOLDER = Path(__file__).parent.parent / ".cache" / PACKAGE.replace("==", "-")


@functools.cache
def openpi_python() -> str:
    """The interpreter of an environment with openpi-client; made once, and kept under .cache.

    Skips the test where the package cannot be installed.
    """
    python = _FOLDER / "bin" / "python"
    done = _FOLDER / "installed"
    _FOLDER.parent.mkdir(exist_ok=True)
    with (_FOLDER.parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests may run in several processes
        if not done.exists() or done.read_text() != _BESIDE:
            install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", PACKAGE, _BESIDE]
            try:
                subprocess.run(
                    [sys.executable, "-m", "venv", "--clear", str(_FOLDER)], check=True, capture_output=True, text=True
                )
                subprocess.run(install, check=True, capture_output=True, text=True, timeout=600)
            except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
                pytest.skip(
                    f"{PACKAGE} cannot be installed: {str(error.stderr or error).strip().splitlines()[-1][:200]}"
                )
            done.write_text(_BESIDE)
    return str(python)
