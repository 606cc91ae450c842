"""Ask a policy for a chunk of actions, and validate the answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.ground.errors import PolicyError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.robots import layout_of


def ask(policy: Policy, observation: Mapping[str, Any]) -> Array:
    """(H, A) actions, H >= 1, an array of its own; A as the robot has it whose proprioception is observed.

    Raises:
        PolicyError: "bad_reply" unless the policy gives that, and finite.
    """
    given = policy.infer(observation)
    if isinstance(given, Mapping):
        keys = ", ".join(map(shown, given))[:200]
        raise PolicyError("bad_reply", f"policy {policy.name}: a mapping with {keys}, not the array of actions itself")
    try:
        chunk = np.asarray(given)
    except ValueError:  # lists of different lengths
        chunk = np.empty(0, object)
    if chunk.dtype.kind not in "fiu":
        raise PolicyError("bad_reply", f"policy {policy.name}: actions that are no numbers")
    size = layout_of(observation["proprioception"]).size
    if chunk.ndim != 2 or len(chunk) == 0 or chunk.shape[1] != size:
        shape = f"a chunk of shape {chunk.shape}, not (H, {size}), H >= 1"
        raise PolicyError("bad_reply", f"policy {policy.name}: {shape}")
    if not np.isfinite(chunk).all():
        raise PolicyError("bad_reply", f"policy {policy.name}: a chunk with numbers that are not finite")
    return chunk.astype(float)
