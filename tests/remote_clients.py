"""Clients of policy servers for tests: quick to give up, with something to show and a way to fail."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import ACTION_SIZE, CAMERAS
from tests.remote_servers import PolicyServer

CHUNK = np.arange(4 * ACTION_SIZE, dtype=np.float32).reshape(4, -1) / 100
QUICK = {"connect_s": 4.0, "answer_s": 4.0, "tries": 2, "max_mb": 1}  # what is told at once is told within these


def quick(**changed: Any) -> DialectSettings:
    """Settings of comet's native server, with short waits."""
    return load_settings("openpi_comet").model_copy(update={**QUICK, **changed})


def policy_at(server: PolicyServer | str, **changed: Any) -> OpenpiPolicy:
    return OpenpiPolicy(server if isinstance(server, str) else server.address, quick(**changed))


def observation(cameras: tuple[str, ...] = CAMERAS, prompt: str = "pick up the cup") -> dict[str, Any]:
    """Of an r1pro, whose numbers are BEHAVIOR's."""
    robot = KinematicRobot()
    felt = replace(robot.proprioception(), robot="r1pro")
    return {"prompt": prompt, "proprioception": felt, "images": {c: robot.look(c) for c in cameras}}


@contextmanager
def fails(reason: str, within_s: float, *words: str) -> Iterator[None]:
    """The block raises a PolicyError of that reason in that time, on one printable line that has the words."""
    began = time.monotonic()
    with pytest.raises(PolicyError) as caught:
        yield
    assert caught.value.reason == reason, caught.value
    assert time.monotonic() - began < within_s
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 700
    assert "openpi:ws" in message
    for word in words:
        assert word in message
