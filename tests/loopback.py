"""Whether nodes of ROS 2 hear each other on this machine: a sandbox may have neither multicast nor shared memory."""

from __future__ import annotations

import os
import time
from functools import cache

import pytest

_WAIT_S = 10.0


def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep nodes among themselves: on this machine, in a domain of this worker. Skips where no message arrives."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(110 + int(worker) % 40))
    if not _arrives():
        pytest.skip(f"no message of ROS 2 arrived on this machine within {_WAIT_S:g} s")


@cache
def _arrives() -> bool:
    """Whether a message goes from one node to another."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions
    from std_msgs.msg import Empty

    contexts = [rclpy.Context(), rclpy.Context()]
    for context in contexts:
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    nodes = [rclpy.create_node(f"probe_{i}", context=context) for i, context in enumerate(contexts)]
    heard: list[object] = []
    nodes[1].create_subscription(Empty, "/probe", heard.append, 1)
    publisher = nodes[0].create_publisher(Empty, "/probe", 1)
    executor = SingleThreadedExecutor(context=contexts[1])
    executor.add_node(nodes[1])
    until = time.monotonic() + _WAIT_S
    while not heard and time.monotonic() < until:
        publisher.publish(Empty())
        executor.spin_once(timeout_sec=0.1)
    for node, context in zip(nodes, contexts, strict=True):
        node.destroy_node()
        context.try_shutdown()
    return bool(heard)
