"""Splits of a task's instances: public ones, which everyone draws alike, and hidden ones, of a secret seed."""

from __future__ import annotations

import hashlib
import os
import zlib
from typing import Literal

import numpy as np

from mpvi_bt.ground.errors import UserError

Split = Literal["public", "hidden"]
HIDDEN_SEED = "MPVI_HIDDEN_SEED"  # environment variable
SHORTEST = 16  # characters of it: a shorter one could be guessed


def hidden_seed() -> str:
    """The secret that hidden instances are drawn from.

    Raises:
        UserError: There is none, or one that could be guessed; it is not shown.
    """
    secret = os.environ.get(HIDDEN_SEED, "").strip()
    if not secret:
        raise UserError(
            f"--split hidden needs the secret seed of its instances in the environment variable {HIDDEN_SEED}; "
            "it is not set."
        )
    if len(secret) < SHORTEST:
        raise UserError(f"{HIDDEN_SEED} has {len(secret)} characters; it needs {SHORTEST} at least, not to be guessed.")
    return secret


def check_split(split: Split) -> None:
    """Raise UserError if the instances of a split cannot be drawn here."""
    if split == "hidden":
        hidden_seed()


def generator(split: Split, problem: str, instance: int, draw: int) -> np.random.Generator:
    """Randomness of one draw of an instance: the instance alone says where things begin, whatever an episode's seed.

    Raises:
        UserError: As of `hidden_seed`.
    """
    if split == "public":
        return np.random.default_rng([zlib.crc32(problem.encode()), instance, draw])
    digest = hashlib.sha256(f"{hidden_seed()}\n{problem}".encode()).digest()
    return np.random.default_rng([*digest, instance, draw])
