"""What runs in a worker process."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import threading
import traceback
from pathlib import Path

from mpvi_bt.errors import ModelError, NoRenderingDevice, UserError
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.store import Fault, Store

_HOPELESS = ("no_key", "wrong_key", "unknown_model", "not_installed")  # language models that answer no episode


def prepare() -> None:
    """See to it that this process ends when the suite's process ends.

    Pool workers outlive a SIGKILL of their parent and would go on with the episode that the next run starts anew.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True, name="follow parent").start()


def run_episode(function: str, config: EpisodeConfig, out: Path) -> Fault | None:
    """Run one episode and write its result.

    Args:
        function: "module:name" of a function from EpisodeConfig to the result, as a dict.
        config: The episode.
        out: The suite's folder.

    Returns:
        None when the result is on disk, else what broke; exceptions stay here, as not all of them can be pickled.
    """
    try:
        module, name = function.split(":")
        result = getattr(importlib.import_module(module), name)(config)
        Store(out).write(config, result)
        if result["ended"] == "backend_error":
            why = result["failures"][-1]
            return Fault(f"{why['reason']}: {why['feedback']}", backend=why["reason"])
    except ModelError as error:
        message = f"{error.reason}: {' '.join(str(error).split())}"
        return Fault(message, hopeless=error.reason in _HOPELESS, backend=error.reason)
    except (Exception, SystemExit) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        message = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {line}"
        hopeless = isinstance(error, UserError | NoRenderingDevice)
        return Fault(message, traceback.format_exc(), hopeless, getattr(error, "exit_code", 3))
    return None
