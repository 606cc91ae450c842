"""`python -m benchmarks.faults.servers`: episodes whose policy is behind a server that fails.

The server fails in every way that has a name. A robot of numbers alone plays the real clients against it. An episode
ends in time with the reason that fits, and the robot held still; or, where the fault is none or can be mended, it goes
on to its end.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import threading
import time
import traceback
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.faults.server_faults import FAULTS, OVER, ServerFault
from benchmarks.faults.trials import Hung, Outcome, crash, drawn, one_line, options, play, unclear, within
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.executive.remote.vla_eval import VlaEvalPolicy
from mpvi_bt.executive.ticking.loop import Outcome as Played
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import BASE

QUICK: dict[str, Any] = {"connect_s": 2.0, "answer_s": 2.0, "tries": 2, "max_mb": 1}
MOST_S = 20.0  # of wall time: of all waits that the settings allow, and as much again for a busy machine
PLACES = {"trash can": (1.0, 0.0), "can of soda": (0.0, 0.5)}


@functools.cache
def _spec() -> Any:
    return compile_plan(RecordedPlanner().plan("picking_up_trash"), load_skills())


def trial(seed: int, number: int, faults: list[ServerFault] = FAULTS) -> Outcome:
    """One episode; the numbers go round all faults."""
    fault = faults[number % len(faults)]
    of = f"{fault.wire}: {fault.name}"
    broke: list[str] = []
    before, threading.excepthook = threading.excepthook, functools.partial(_note, broke)
    os.environ.pop(KEY, None)
    OVER.clear()
    began = time.monotonic()
    try:
        with fault.serve(drawn(seed, number)) as address:
            try:
                with within(MOST_S, 4 * MOST_S):
                    played, world = episode(fault.wire, address)
                took_s = time.monotonic() - began
            finally:
                OVER.set()
    except Hung as error:
        return Outcome(of, "hung", one_line(str(error)))
    except Exception as error:
        return Outcome(of, "crashed", crash(error))
    finally:
        threading.excepthook = before
    if broke:
        return Outcome(of, "crashed", f"in a thread: {broke[0]}")
    if took_s > MOST_S:
        return Outcome(of, "hung", f"{took_s:.0f} s of wall time")
    return judge(of, fault, played, world)


def judge(of: str, fault: ServerFault, played: Played, world: KinematicWorld) -> Outcome:
    """Whether an episode ended as it should."""
    told = f"{played.failure.reason}: {played.failure.evidence}" if played.failure else played.ending
    if not fault.due:
        fine = played.ending == "time_limit"
        return Outcome(of, "went on") if fine else Outcome(of, "misread", f"it should have gone on: {told}")
    if played.ending != "backend_error" or played.failure is None or played.failure.reason not in fault.due:
        return Outcome(of, "misread", f"{' or '.join(fault.due)} should be told, not {told}")
    if wrong := unclear(told) or "not printable" * (not told.isprintable()):
        return Outcome(of, "crashed", f"not clear ({wrong}): {told}")
    return Outcome(of, "refused", told) if _is_still(world) else Outcome(of, "misread", "the robot goes on moving")


def episode(wire: str, address: str) -> tuple[Played, KinematicWorld]:
    """An episode of a few simulated seconds whose policy is at an address."""
    world, skills = KinematicWorld(), load_skills()
    context = scripted_context(world, skills, PLACES, {})
    policy: OpenpiPolicy
    if wire == "openpi":
        policy = OpenpiPolicy(address, DialectSettings(**QUICK))
    else:
        policy = VlaEvalPolicy(address, DialectSettings(**QUICK))
    context = dataclasses.replace(context, policy=policy)
    try:
        return run_episode(Tree(_spec()), world, context, [], max_time_s=4.0), world
    finally:
        policy.close()


def _is_still(world: KinematicWorld) -> bool:
    """Whether the robot stays where it is, as it was last told."""
    if world.robot.action[BASE].any():
        return False
    before = world.robot.proprioception()
    for _ in range(30):
        world.step()
    after = world.robot.proprioception()
    arms = (np.allclose(after.arm[side], before.arm_command[side], atol=1e-6) for side in SIDES)
    return np.array_equal(before.base_pose, after.base_pose) and all(arms)


def _note(broke: list[str], failed: threading.ExceptHookArgs) -> None:
    """Take down what a thread of ours died of; threads of fake servers may."""
    if any("mpvi_bt" in frame.filename for frame in traceback.extract_tb(failed.exc_traceback)):
        broke.append(one_line(f"{failed.exc_type.__name__}: {failed.exc_value}"))


@click.command()
@options(len(FAULTS), "servers")
def main(seed: int, count: int, out: Path, only: int | None) -> None:
    """Play episodes against servers that fail, and say what came of it."""
    play(functools.partial(trial, seed), seed, count, out, only, "servers")


if __name__ == "__main__":
    main()
