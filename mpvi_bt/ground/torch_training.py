"""Torch for training: the module, a device to train on, and how far a training has come."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install


def torch_for_training() -> Any:
    """The module. Raises UserError if it is not installed."""
    try:
        import torch
    except ImportError as error:
        raise UserError(f"training needs torch: {install('train')}") from error
    return torch


def seeded_torch(device: str, seed: int) -> Any:
    """The module, with one thread and a seed, so that a CPU makes the same weights again.

    Raises:
        UserError: It is not installed, or has no such device.
    """
    torch = torch_for_training()
    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise UserError(f"torch cannot use the device {device!r}: {str(error).splitlines()[0]}") from None
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    return torch


def kept_training(path: Path) -> dict[str, Any]:
    """What a training has kept in a file. Raises UserError if that is no such file."""
    try:
        state: dict[str, Any] = torch_for_training().load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
        why = str(error).splitlines()[0][:100]
        raise UserError(f"{path}: is no kept training ({why}); delete it to begin anew.") from None
    return state
