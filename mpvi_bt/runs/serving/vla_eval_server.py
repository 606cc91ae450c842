"""Our policies as a model server of the vla-eval package: `python -m mpvi_bt.runs.serving.vla_eval_server`.

It takes the whole observation, as `mpvi serve` does, and tells the benchmark so. docs/vla_eval.md tells how it is used.
"""

from __future__ import annotations

from typing import Any

from vla_eval.model_servers.base import ModelServer, SessionContext
from vla_eval.model_servers.serve import run_server
from vla_eval.specs import DimSpec

from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.executive.remote.policy_server import Session
from mpvi_bt.executive.remote.server import Unseen
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.choices.policies import for_clients
from mpvi_bt.runs.serving.vla_eval_benchmark import action_spec, observation_spec

SETTINGS = "mpvi"  # the whole observation, and our own numbers


class MpviModelServer(ModelServer):  # type: ignore[misc]  # vla_eval is untyped
    """Any policy that needs no simulator. Each session has one of its own, made anew for each episode.

    Args:
        policy: Such as "reactive".
        seed: Of everything random.

    Raises:
        UserError: There is no such policy, or it reads the simulator.
    """

    def __init__(self, policy: str = "reactive", seed: int = 0) -> None:
        self._make = for_clients(policy, seed)
        self._settings = load_settings(SETTINGS)
        self._sessions: dict[str, Session] = {}
        self._live: set[str] = set()  # sessions whose observations do not wait for answers
        self._first = list(self._make({}).cameras)  # what cannot be made is told now, not to the first client

    async def on_episode_start(self, config: dict[str, Any], ctx: SessionContext) -> None:
        """Make a policy."""
        await self.on_episode_end({}, ctx)
        self._sessions[ctx.session_id] = session = Session(self._make)
        if config.get("mode") == "live":
            self._live.add(ctx.session_id)
        await session.begin()

    async def on_observation(self, obs: dict[str, Any], ctx: SessionContext) -> None:
        """Send the policy's whole chunk. Raises Refused, UserError.

        A live observation that was sent before the answer that asks for pictures had come gets none: the robot holds.
        """
        if ctx.session_id not in self._sessions:
            raise UserError("an observation came before its episode was started.")
        try:
            answer, _ = await self._sessions[ctx.session_id].answer(obs)
        except Unseen:
            if ctx.session_id in self._live:
                return
            raise
        await ctx.send_action(answer)

    async def on_episode_end(self, result: dict[str, Any], ctx: SessionContext) -> None:
        """Let go of the policy."""
        self._live.discard(ctx.session_id)
        if session := self._sessions.pop(ctx.session_id, None):
            session.end()

    def get_action_spec(self) -> dict[str, DimSpec]:
        """The numbers of the default robot."""
        return action_spec(self._settings, robot_named(DEFAULT_ROBOT))

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """The whole observation."""
        return observation_spec(self._settings)

    def get_observation_params(self) -> dict[str, Any]:
        """What the benchmark is to be made with, unless its config says otherwise."""
        return {"policy_settings": SETTINGS, "cameras": self._first}


if __name__ == "__main__":
    run_server(MpviModelServer)
