"""A behavior-tree executive for long-horizon mobile manipulation.

    import mpvi_bt

    result = mpvi_bt.run("picking_up_trash", policy="reactive", instance=1)
    print(result.q, result.failures)

Everything here loads when it is first used, so that importing costs nothing (docs/python.md).
"""

import sys
from typing import TYPE_CHECKING, Any

from mpvi_bt.ground.moved import OldNames
from mpvi_bt.ground.version import __version__ as __version__

if TYPE_CHECKING:  # for type checkers and editors; `__getattr__` loads the same
    from mpvi_bt.apps.api import check, compile_plan, load_plan, load_task, load_tree, run, run_dry, run_suite
    from mpvi_bt.executive.plan.schema import Plan
    from mpvi_bt.executive.tree.spec import TreeSpec
    from mpvi_bt.ground.errors import BackendError, FileProblems, MpviError, NodeError, Problem, UserError
    from mpvi_bt.house.instances.tasks import Task
    from mpvi_bt.runs.choices.config import EpisodeConfig
    from mpvi_bt.runs.episode.result import Result

__all__ = [
    "BackendError",
    "EpisodeConfig",
    "FileProblems",
    "MpviError",
    "NodeError",
    "Plan",
    "Problem",
    "Result",
    "Task",
    "TreeSpec",
    "UserError",
    "check",
    "compile_plan",
    "load_plan",
    "load_task",
    "load_tree",
    "run",
    "run_dry",
    "run_suite",
]

sys.meta_path.append(OldNames())

_API = "mpvi_bt.apps.api"
_ERRORS = "mpvi_bt.ground.errors"
_HOMES = {  # of what is not in the API itself
    "BackendError": _ERRORS,
    "EpisodeConfig": "mpvi_bt.runs.choices.config",
    "FileProblems": _ERRORS,
    "MpviError": _ERRORS,
    "NodeError": _ERRORS,
    "Plan": "mpvi_bt.executive.plan.schema",
    "Problem": _ERRORS,
    "Result": "mpvi_bt.runs.episode.result",
    "Task": "mpvi_bt.house.instances.tasks",
    "TreeSpec": "mpvi_bt.executive.tree.spec",
    "UserError": _ERRORS,
}


def __getattr__(name: str) -> Any:
    """Load what is asked for. Raises AttributeError for what is not here, as Python wants it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(_HOMES.get(name, _API)), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """What `import mpvi_bt` offers, for completion."""
    return sorted([*globals(), *__all__])
