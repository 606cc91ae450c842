"""A model server made with the published vla-eval package, in a thread of this process."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from anyio.from_thread import start_blocking_portal
from vla_eval.model_servers.base import SessionContext
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import serve_async
from vla_eval.specs import IMAGE_RGB, LANGUAGE, RAW, DimSpec

R1PRO = {"joints": DimSpec("joints", 23, "joint_positions_r1pro")}


class Model(PredictModelServer):  # type: ignore[misc]
    """Answers with what it was sent: the k-th action of a chunk begins with the step and k.

    Args:
        horizon: Actions of a chunk.
        action_spec: What it says that its actions are.
        broken: Raise on every observation.
        options: Of the package's class, such as `chunk_size`.
    """

    def __init__(
        self, horizon: int = 4, action_spec: dict[str, DimSpec] = R1PRO, broken: bool = False, **options: Any
    ) -> None:
        super().__init__(**options)
        self.horizon, self.action_spec, self.broken = horizon, action_spec, broken
        self.seen: list[dict[str, Any]] = []
        self.episodes: list[dict[str, Any]] = []
        self.ended = 0

    def get_action_spec(self) -> dict[str, DimSpec]:
        return self.action_spec

    def get_observation_spec(self) -> dict[str, DimSpec]:
        return {
            "head": IMAGE_RGB,
            "left_wrist": IMAGE_RGB,
            "right_wrist": IMAGE_RGB,
            "state": RAW,
            "language": LANGUAGE,
        }

    async def on_episode_start(self, config: dict[str, Any], ctx: SessionContext) -> None:
        self.episodes.append(config)
        await super().on_episode_start(config, ctx)

    async def on_episode_end(self, result: dict[str, Any], ctx: SessionContext) -> None:
        self.ended += 1
        await super().on_episode_end(result, ctx)

    def predict(self, obs: dict[str, Any], ctx: SessionContext) -> dict[str, Any]:
        if self.broken:
            raise RuntimeError("out of memory")
        self.seen.append(obs)
        actions = np.zeros((self.horizon, 23), np.float32)
        actions[:, 3:7] = obs["states"][3:7]
        actions[:, 0] = ctx.step / 100
        actions[:, 1] = np.arange(self.horizon) / 100
        return {"actions": actions}


@contextlib.contextmanager
def model_server(model: Model, port: int = 0) -> Iterator[str]:
    """Its address, HOST:PORT; at any port that is free where none is given."""
    with start_blocking_portal() as portal:
        task, port = portal.start_task(serve_async, model, "127.0.0.1", port)
        try:
            yield f"127.0.0.1:{port}"
        finally:
            task.cancel()
