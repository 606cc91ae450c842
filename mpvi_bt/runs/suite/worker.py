"""What runs in a worker process, on this machine or on another."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import threading
import traceback
from dataclasses import dataclass
from typing import Any

from mpvi_bt.ground.errors import DiskFull, ModelError, NoRenderingDevice, UserError
from mpvi_bt.ground.writing import FULL
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.suite.store import Fault

# Of numeric libraries and of Mesa's renderer. Set to 1: each core has its worker.
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS")
EPISODES_A_PROCESS = 40  # Our choice: the renderer keeps some memory of every scene
_HOPELESS = ("no_key", "wrong_key", "unknown_model", "not_installed")  # language models that answer no episode


@dataclass(frozen=True)
class Played:
    """What came of one attempt at an episode.

    Attributes:
        result: Ready for JSON; None: there is none.
        fault: What broke; None: nothing did. A backend that fails leaves both.
    """

    result: dict[str, Any] | None = None
    fault: Fault | None = None


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


def play(function: str, config: EpisodeConfig) -> Played:
    """Play one episode.

    Args:
        function: "module:name" of a function from EpisodeConfig to the result, as a dict.
        config: The episode.

    Returns:
        Its result, or what broke; exceptions stay here, as not all of them can be pickled.
    """
    try:
        module, name = function.split(":")
        result = Result.model_validate(getattr(importlib.import_module(module), name)(config))
        fault = None
        if result.ended == "backend_error":
            why = result.failures[-1]
            fault = Fault(f"{why.reason}: {why.feedback}", backend=why.reason)
        return Played(result.model_dump(mode="json"), fault)
    except ModelError as error:
        message = f"{error.reason}: {' '.join(str(error).split())}"
        return Played(fault=Fault(message, hopeless=error.reason in _HOPELESS, backend=error.reason))
    except (Exception, SystemExit) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        full = isinstance(error, DiskFull) or (isinstance(error, OSError) and error.errno in FULL)
        message = str(error) if isinstance(error, UserError | DiskFull) else f"{type(error).__name__}: {line}"
        hopeless = full or isinstance(error, UserError | NoRenderingDevice)
        code = getattr(error, "exit_code", 3)
        return Played(fault=Fault(message, traceback.format_exc(), hopeless, code))
