"""Whether ROS 2 is there, and what to install or to source where it is not."""

from __future__ import annotations

import importlib
import sys
from typing import Any

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install

# What the wheels of the extra hold; all others come with an installation of ROS 2 alone.
_WHEELS = (
    *("rclpy", "std_srvs", "builtin_interfaces", "diagnostic_msgs", "visualization_msgs", "rosgraph_msgs"),
    *("geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "trajectory_msgs"),
)


def part(name: str, use: str) -> Any:
    """A class or module of ROS 2, such as ("std_srvs.srv:Trigger", "pausing by a service").

    Raises:
        UserError: Its package is not installed; says which, and what it was for.
    """
    module, _, attribute = name.partition(":")
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise UserError(_missing(module.split(".")[0], use, error)) from None
    return getattr(found, attribute) if attribute else found


def is_there(module: str) -> bool:
    """Whether a module of ROS 2, such as "std_srvs.srv", can be loaded."""
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


def require_ros() -> None:
    """Raise UserError if rclpy or the messages that every bridge needs cannot be loaded."""
    for name in ("rclpy", "geometry_msgs.msg", "nav_msgs.msg", "rosgraph_msgs.msg", "sensor_msgs.msg", "std_msgs.msg"):
        part(name, "mpvi ros2")
    part("trajectory_msgs.msg", "mpvi ros2")


def _missing(package: str, use: str, error: ImportError) -> str:
    absent = isinstance(error, ModuleNotFoundError) and (error.name or "").split(".")[0] == package
    why = "is not installed" if absent else f"cannot be loaded ({error})"
    source = "source your installation of ROS 2, as in `source /opt/ros/kilted/setup.bash`"
    if package not in _WHEELS:
        return f"{use} needs the package {package} of ROS 2, which {why}: {source} that has {package}."
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    if (sys.version_info[:2], sys.platform) == ((3, 11), "linux"):
        return f"{use} needs {package}, which {why}: {install('ros2')}, or {source}."
    return f"{use} needs {package}, which {why}: {source}, with a Python {here}; wheels are for CPython 3.11 on Linux."
