"""What several tests share."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from tests import warm
from tests.chat_servers import real_chat_server, scripted_chat_server
from tests.suite_runs import log

__all__ = ["log", "mpvi", "real_chat_server", "scripted_chat_server"]

# A shell that runs the tests in the background lets them ignore Ctrl-C, and what they start inherits that; the tests of
# Ctrl-C need it back. A handler of ours becomes the default again in a new process.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples whenever the same files are run, so that nobody's tests fail by chance (numbers that stand in loaded
# modules are tried, too: other files, other examples); HYPOTHESIS_PROFILE=explore looks further.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

Shell = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def mpvi(tmp_path: Path) -> Shell:
    """Run `mpvi ARGS...` in a process of its own, in an empty folder or `cwd`, as a user would.

    The process is a fork of one that has imported the package, unless variables are given that are read on import.
    """

    def run(
        *args: str, timeout: float = 60, stdin: str = "", cwd: Path = tmp_path, **env: str
    ) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "COLUMNS": "80", **env}
        if any(name.startswith(("PYTHON", "NUMBA")) for name in env):
            return subprocess.run(
                [sys.executable, *warm.MPVI, *args],
                cwd=cwd,
                env=environment,
                input=stdin,
                capture_output=True,
                text=True,
                timeout=timeout,
                check=False,
            )
        return warm.python(*warm.MPVI, *args, cwd=cwd, env=environment, stdin=stdin, timeout=timeout)

    return run
