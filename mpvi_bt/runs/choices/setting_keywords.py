"""Keywords of `mpvi_bt.run` and `mpvi_bt.run_suite` for type checkers, made of the fields of `EpisodeConfig`.

Not edited by hand: `python -m tests.setting_keywords` writes it.
"""

from __future__ import annotations

from os import PathLike
from typing import Literal, TypedDict

File = str | PathLike[str]


class SuiteKeywords(TypedDict, total=False):
    """What the episodes of a suite may have in common."""

    split: Literal["public", "hidden"]
    house: str | None
    planner: str
    drive: Literal["navigator", "policy"]
    on_failure: str
    unit: str | None
    calibration: str | None
    map: str
    detector: str
    navigator: str
    policy: str
    policy_settings: str | None
    policy_horizon: int | None
    policy_ensemble: float | None
    policy_rate: float | None
    policy_actions: Literal["absolute", "delta", "velocity"] | None
    pregrasp: bool
    pregrasp_hand: Literal["left", "right"] | None
    checker: str
    trigger: str
    while_asked: Literal["go_on", "hold"]
    policy_faults: str | None
    latency: str | None
    while_inferring: Literal["hold", "go_on"]
    robot: str
    sim: Literal["sapien", "maniskill"]
    assisted: bool
    substitute: str | None
    exchanges: File | None
    offline: bool
    calls: int | None
    tokens: int | None


class EpisodeKeywords(SuiteKeywords, total=False):
    """What one episode may be told."""

    instance: int
    seed: int
    video: File | None
    picture: File | None
    rerun: File | None
    mcap: File | None
    demonstration: File | None
    demonstration_fps: Literal[1, 2, 3, 5, 6, 10, 15, 30]
    times: File | None
    profile: File | None
