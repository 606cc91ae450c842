"""A pretrained policy of LeRobot's in this process, made by LeRobot's own factory with its own processors."""

from __future__ import annotations

import importlib.metadata
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.connection import one_line
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.lerobot_checkpoint import fitting_checkpoint, rate_of
from mpvi_bt.executive.remote.lerobot_frames import cameras_of_checkpoint, frame_of
from mpvi_bt.executive.remote.wire_mapping import actions_of
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.protocol import Proprioception

OLDEST, NEWEST = "0.4", "0.6"  # of lerobot: 0.4.4 and 0.6.1 were tried


def require_lerobot() -> None:
    """Raise UserError if lerobot is not installed, or is older or newer than what was tried."""
    try:
        version = importlib.metadata.version("lerobot")
    except importlib.metadata.PackageNotFoundError:
        said = f"checkpoints of LeRobot's need lerobot, in an environment of its own: {install('lerobot')}"
        raise UserError(f"{said} (docs/lerobot.md)") from None
    if not _series(OLDEST) <= _series(version) <= _series(NEWEST):
        known = f"{OLDEST} to {NEWEST} are known here"
        raise UserError(f"lerobot {version} is installed, and {known}: {install('lerobot')}")


def _series(version: str) -> list[int]:
    """The first two numbers of a version."""
    return [int(number) for number in re.findall(r"\d+", version)[:2]]


class LerobotPolicy:
    """A checkpoint of LeRobot's; it is loaded when it is first needed.

    Args:
        folder: Of the checkpoint, or what `lerobot-train` wrote.
        settings: What its features are.
        robot: Name or file of the robot; None: that of the settings, of its dataset, or the default one.

    Raises:
        UserError: There is no checkpoint, it does not fit the robot, or lerobot is missing.

    Attributes:
        checkpoint: What it says of itself.
        name: "lerobot:" and the folder.
        cameras: Those whose pictures it is shown.
        rate_hz: Rows a second, of the settings or of the dataset that it was trained on; None: nobody says.
        rate_from: Who says it.
        actions: What the joints in a row are.
    """

    def __init__(self, folder: Path, settings: DialectSettings, robot: str | None = None) -> None:
        self.checkpoint = fitting_checkpoint(folder, settings, robot)
        require_lerobot()
        self._settings = settings
        self.name = f"lerobot:{folder}"
        self.cameras = cameras_of_checkpoint(self.checkpoint, settings)
        self.rate_hz, self.rate_from = rate_of(self.checkpoint, settings)
        self.actions: ActionKind = settings.actions or self.checkpoint.actions or "absolute"
        self._held: Proprioception | None = None
        self._loaded: _Loaded | None = None

    def reset(self) -> None:
        """Forget everything, observations and what is left of a chunk."""
        self._held = None
        if self._loaded is not None:
            self._loaded.reset()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, A): a chunk, or a row of a policy that remembers what it saw.

        Raises:
            PolicyError: The checkpoint cannot be loaded, or fails.
        """
        body: Proprioception = observation["proprioception"]
        self._held = self._held or body
        frame = frame_of(observation, self.checkpoint, self._settings)
        rows = self.checkpoint.rows if self.checkpoint.whole_chunks else None
        try:
            if self._loaded is None:
                self._loaded = _Loaded(self.checkpoint.folder, self._settings.device)
            answer = self._loaded.answer(frame, observation["prompt"], rows)
        except Exception as error:  # whatever a policy of somebody else's may raise
            said = one_line(f"{type(error).__name__}: {error}")
            raise PolicyError("server_error", f"{self.name}: {said}") from error
        action = self._settings.action.model_copy(update={"key": "actions"})
        return actions_of({"actions": answer}, action, self._held, body)

    def close(self) -> None:
        """Let go of the network."""
        self._loaded = None


class _Loaded:
    """Network and processors, as LeRobot makes them."""

    def __init__(self, folder: Path, device: str | None) -> None:
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        config = PreTrainedConfig.from_pretrained(folder)
        config.device = device or config.device  # LeRobot takes another one where that of the training is not there
        self._device = str(config.device)
        self._policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self._policy.to(self._device)
        self._policy.eval()
        on = {"device_processor": {"device": self._device}}
        self._before, self._after = make_pre_post_processors(
            config, pretrained_path=str(folder), preprocessor_overrides=on, postprocessor_overrides=on
        )
        self.reset()

    def reset(self) -> None:
        for one in (self._policy, self._before, self._after):
            one.reset()

    def answer(self, frame: Mapping[str, np.ndarray[Any, Any]], prompt: str, rows: int | None) -> Array:
        """(H, n) the first rows of a chunk, or (1, n) the next action if `rows` is None."""
        import torch

        batch: dict[str, Any] = {"task": prompt, "robot_type": ""}
        for key, value in frame.items():
            tensor = torch.from_numpy(np.ascontiguousarray(value))
            batch[key] = (tensor.permute(2, 0, 1).float() / 255 if value.ndim == 3 else tensor)[None].to(self._device)
        with torch.inference_mode():
            seen = self._before(batch)
            if rows is None:
                chunk = self._after(self._policy.select_action(seen))
            else:
                whole = self._policy.predict_action_chunk(seen)[0, :rows]
                chunk = torch.cat([self._after(row[None]) for row in whole])
        answer: Array = chunk.float().cpu().numpy()
        return answer
