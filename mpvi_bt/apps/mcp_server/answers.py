"""Answers of the tools: typed results, with schemas for the client."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class TaskLine(BaseModel):
    """A task."""

    name: str
    instruction: str
    instances: int = Field(description="How many start states there are, from 0.")
    budget_s: float = Field(description="Simulated time that an episode may take.")


class Tasks(BaseModel):
    """What can be asked for."""

    tasks: list[TaskLine]
    skills: dict[str, str] = Field(description="Manipulation skills that trees and plans can name, and what each does.")
    trees: list[str] = Field(description="Names of trees that are on file.")


class TaskScene(BaseModel):
    """The names that plans and trees may use in a task. Where the robot begins is not part of it."""

    task: str
    instruction: str
    house: str
    rooms: dict[str, list[str]] = Field(description="Each room with its fixtures, as people call them.")
    targets: list[str] = Field(description="Every name that can be driven to.")


class Found(BaseModel):
    """Something that is wrong, or doubtful."""

    line: int
    column: int
    code: str
    severity: str
    message: str


class CheckedText(BaseModel):
    """What is wrong with a text."""

    ok: bool = Field(description="Whether it can be run: it has no error, and no step of a plan is impossible.")
    problems: list[Found]


class TaskPlan(BaseModel):
    """The recorded plan of a task."""

    task: str
    plan: str = Field(description="As JSON, version and segments.")
    tree: str = Field(description="The tree that it compiles to, as YAML: change it and hand it to check and run.")


class Preview(BaseModel):
    """A tree, drawn."""

    name: str
    nodes: int
    parameters: dict[str, str] = Field(description="Its parameters, of which `parameters` gives values.")
    drawing: str


class Started(BaseModel):
    """A run that has begun."""

    run: str = Field(description="Its id, for progress, explain and stop.")
    dry: bool
    trace: str = Field(description="Address of its trace as a resource.")


class RunProgress(BaseModel):
    """How far a run is."""

    run: str
    state: Literal["starting", "running", "ended"]
    tick: int
    time_s: float = Field(description="Simulated time.")
    doing: list[str] = Field(description="Paths of the leaves that run now.")
    latest: list[str] = Field(description="The last failures, answers of the checker and new plans.")
    outcome: str = Field(description="How it ended, q first where a goal is scored; empty before.")


class RunExplanation(BaseModel):
    """Why a run ended as it did."""

    run: str
    text: str


class StoppedRun(BaseModel):
    """A run that was stopped."""

    run: str
    outcome: str
