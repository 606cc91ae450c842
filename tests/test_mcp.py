"""The MCP server, asked by the SDK's own client: in the same process, over stdin and stdout, and over HTTP."""

from __future__ import annotations

import json
import os
import random
import re
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import anyio
import pytest

pytest.importorskip("mcp")

import jsonschema
from mcp import Client, MCPError, StdioServerParameters, stdio_client
from mcp.client.streamable_http import streamable_http_client

from mpvi_bt.apps.mcp_server.run_processes import RunProcesses
from mpvi_bt.apps.mcp_server.tool_server import make_server
from mpvi_bt.apps.mcp_server.tools import Tools
from tests.test_watch import MPVI, serving

WORDS = ["tasks", "scene", "plan", "check", "preview", "run", "progress", "explain", "stop"]
WAITS = "tree: waits\nroot:\n  sequence: all\n  memory: true\n  children: [{wait: 2}, {fail: nothing_there}]\n"
FOREVER = "tree: forever\nroot:\n  repeat: 1000000\n  child: {wait: 0.1}\n"


def asked(folder: Path, ask: Callable[[Client], Awaitable[None]], allow_motion: bool = False) -> None:
    """Ask a server in this process."""
    runs = RunProcesses(folder)

    async def session() -> None:
        async with Client(make_server(Tools(runs, allow_motion))) as client:
            await ask(client)

    try:
        anyio.run(session)
    finally:
        runs.close()


async def call(client: Client, tool: str, **given: Any) -> dict[str, Any]:
    """What a tool answers; an error as {"error": TEXT}."""
    answer = await client.call_tool(tool, given)
    if answer.is_error:
        return {"error": answer.content[0].text}  # type: ignore[union-attr]
    assert answer.structured_content is not None
    return dict(answer.structured_content)


def test_nine_tools_say_what_they_take_answer_and_do(tmp_path: Path) -> None:
    """Each has a schema of what it takes and one of what it answers, a text, and says whether it only reads."""

    async def ask(client: Client) -> None:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert sorted(tools) == sorted(WORDS)
        for name, tool in tools.items():
            assert tool.description
            assert tool.output_schema
            assert tool.input_schema["type"] == "object"
            assert tool.annotations is not None
            assert tool.annotations.read_only_hint is (name not in ("run", "stop"))
            assert not {"report", "ctx"} & tool.input_schema["properties"].keys()

    asked(tmp_path, ask)


def test_an_agent_finds_its_way(tmp_path: Path) -> None:
    """From tasks over scene and plan to a tree that is checked, drawn, run dry, and whose failure is explained."""

    async def ask(client: Client) -> None:
        tasks = await call(client, "tasks")
        assert "picking_up_trash" in [task["name"] for task in tasks["tasks"]]
        scene = await call(client, "scene", task="picking_up_trash")
        assert "kitchen" in scene["rooms"]
        plan = await call(client, "plan", task="picking_up_trash")
        assert (await call(client, "check", tree=plan["tree"], task="picking_up_trash"))["ok"]
        wrong = await call(client, "check", tree="tree: t\nroot:\n  wiat: 2\n")
        assert not wrong["ok"]
        assert (wrong["problems"][0]["line"], "wait" in wrong["problems"][0]["message"]) == (3, True)
        assert "--> wait 2 s" in (await call(client, "preview", tree=WAITS))["drawing"]
        run = (await call(client, "run", tree=WAITS))["run"]
        told: list[float] = []

        async def tell(progress: float, total: float | None, message: str | None) -> None:
            told.append(progress)

        answer = await client.call_tool("progress", {"run": run, "wait_s": 40}, progress_callback=tell)
        progress = answer.structured_content or {}
        assert (progress["state"], progress["time_s"]) == ("ended", pytest.approx(2.0, abs=0.1))
        assert "failed" in progress["outcome"]
        assert "nothing_there" in (await call(client, "explain"))["text"]
        trace = (await client.read_resource(f"mpvi://runs/{run}/trace")).contents[0].text  # type: ignore[union-attr]
        assert json.loads(trace.splitlines()[-1])["end"] == "failure"

    asked(tmp_path, ask)


def test_nothing_moves_without_leave(tmp_path: Path) -> None:
    """A run that is not dry is refused, with the option that would allow it; nothing is started."""

    async def ask(client: Client) -> None:
        refused = await call(client, "run", task="picking_up_trash", dry=False)
        assert "--allow-motion" in refused["error"]
        assert "nothing has been run" in (await call(client, "progress"))["error"]

    asked(tmp_path, ask)
    assert not list(tmp_path.iterdir())


def test_one_run_holds_the_robot(tmp_path: Path) -> None:
    """A second run is told who holds it and how to go on; stopped, it is free."""

    async def ask(client: Client) -> None:
        first = (await call(client, "run", tree=FOREVER))["run"]
        second = await call(client, "run", tree=WAITS)
        assert re.search(rf"run {first} \(a tree, dry\) holds the robot, since \d+ s", second["error"])
        while (await call(client, "progress"))["state"] == "starting":
            await anyio.sleep(0.1)
        assert "interrupted" in (await call(client, "stop", run=first))["outcome"]
        assert (await call(client, "run", tree=WAITS))["run"] != first

    asked(tmp_path, ask)


@pytest.mark.parametrize("task", ["../tasks/picking_up_trash", "/etc/passwd", "--help", "picking_up_trahs", ""])
def test_only_known_tasks_are_named(task: str, tmp_path: Path) -> None:
    """A client names tasks, not paths and not options."""

    async def ask(client: Client) -> None:
        for tool in ("scene", "plan", "preview", "run"):
            assert "error" in await call(client, tool, task=task)

    asked(tmp_path, ask)
    assert not list(tmp_path.iterdir())


GREETS = "tree: greets\nparameters:\n  word: text\n  laps: {type: integer, default: 2}\nroot: {say: $word}\n"
RUNS = ["progress", "explain", "stop"]


@pytest.mark.parametrize("word", WORDS)
def test_every_tool_refuses_what_it_does_not_take(word: str, tmp_path: Path) -> None:
    """By its schema and when it is called: a misspelt argument is named with the nearest one, and nothing is begun."""

    async def ask(client: Client) -> None:
        (tool,) = [tool for tool in (await client.list_tools()).tools if tool.name == word]
        assert tool.input_schema["additionalProperties"] is False
        for name in tool.input_schema["properties"]:
            error = (await call(client, word, **{name[:-1]: "1"}))["error"]
            assert f"unknown argument {name[:-1]!r}. Did you mean {name!r}?" in error
        assert "unknown argument 'nonsense'" in (await call(client, word, nonsense=1))["error"]

    asked(tmp_path, ask)
    assert not list(tmp_path.iterdir())


def test_a_tool_that_is_not_there_is_refused_with_the_nearest(tmp_path: Path) -> None:
    """As any name."""

    async def ask(client: Client) -> None:
        assert "unknown tool 'chek'. Did you mean 'check'?" in (await call(client, "chek", tree=WAITS))["error"]

    asked(tmp_path, ask)


def test_a_run_that_is_not_there_is_no_other_one(tmp_path: Path) -> None:
    """Whatever stands for its id: only where no id is given, the last run is meant."""

    async def ask(client: Client) -> None:
        run = (await call(client, "run", tree=WAITS))["run"]
        for tool in RUNS:
            for odd in ("99", "", "null", "latest", f" {run}", f"{run}\x00", "../1", 1, True, [run], {"run": run}):
                assert "error" in await call(client, tool, run=odd), (tool, odd)
            assert f"unknown run '99'. Known: {run}." in (await call(client, tool, run="99"))["error"]
        with pytest.raises(MCPError, match="unknown run '99'"):
            await client.read_resource("mpvi://runs/99/trace")
        assert (await call(client, "progress"))["run"] == run

    asked(tmp_path, ask)


def test_an_argument_means_the_same_in_every_tool(tmp_path: Path) -> None:
    """One name has one type, and the same words in it where it is the same thing."""

    async def ask(client: Client) -> None:
        types: dict[str, set[str]] = {}
        for tool in (await client.list_tools()).tools:
            for name, schema in tool.input_schema["properties"].items():
                kinds = [part["type"] for part in schema.get("anyOf", [schema]) if part.get("type") != "null"]
                types.setdefault(name, set()).add(json.dumps(kinds))
                said = schema["description"]
                if name in ("tree", "parameters", "run"):
                    types.setdefault(f"{name}'s words", set()).add(said)
        assert all(len(found) == 1 for found in types.values()), types
        assert "text" not in types

    asked(tmp_path, ask)


def test_parameters_of_a_tree_are_given(tmp_path: Path) -> None:
    """They are checked before anything runs, drawn, and run with; a tree may be JSON."""

    async def ask(client: Client) -> None:
        refused = (await call(client, "run", tree=GREETS))["error"]
        assert refused == "tree 'greets' needs values for its parameters: word (text)"
        wrong = await call(client, "check", tree=GREETS, parameters={"word": "hello", "lap": 1})
        assert "Did you mean 'laps'?" in wrong["error"]
        assert (await call(client, "check", tree=GREETS, parameters={"word": "hello", "laps": 3}))["ok"]
        assert "laps" in (await call(client, "check", tree=GREETS, parameters={"word": "hello", "laps": "x"}))["error"]
        drawn = await call(client, "preview", tree=GREETS, parameters={"word": "hello there"})
        assert "hello there" in drawn["drawing"]
        assert drawn["parameters"] == {"word": "text, has to be given", "laps": "integer, 2 by default"}
        as_json = json.dumps({"tree": "says", "parameters": {"word": "text"}, "root": {"say": "$word"}})
        run = (await call(client, "run", tree=as_json, parameters={"word": "hi = there"}))["run"]
        ended = await call(client, "progress", run=run, wait_s=40)
        assert ended["outcome"].startswith("tree succeeded"), ended
        assert "parameters are those of a tree" in (await call(client, "run", task="picking_up_trash",
                                                                parameters={"word": "a"}))["error"]  # fmt: skip

    asked(tmp_path, ask)


def test_what_stands_for_a_tree_or_a_plan_is_one(tmp_path: Path) -> None:
    """A word that names no tree is told with the nearest; a plan is no tree, nor a tree a plan."""

    async def ask(client: Client) -> None:
        for tool in ("check", "preview", "run"):
            assert "unknown tree 'ftech'. Did you mean 'fetch'?" in (await call(client, tool, tree="ftech"))["error"]
        plan = (await call(client, "plan", task="picking_up_trash"))["plan"]
        assert (await call(client, "check", plan=plan))["ok"]
        assert "tree: this is a plan, not a tree" in (await call(client, "check", tree=plan))["error"]
        assert "plan: this is a tree, not a plan" in (await call(client, "check", plan=WAITS))["error"]

    asked(tmp_path, ask)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"tree": WAITS, "policy": "expert"}, "dry=false"),
        ({"tree": WAITS, "on_failure": "replan"}, "dry=false"),
        ({"tree": WAITS, "instance": 3}, "name the task"),
        ({"task": "picking_up_trash", "instance": 900}, "out of range"),
        ({"task": "picking_up_trash", "dry": "false"}, "dry: should be true or false, not 'false'"),
        ({"task": "picking_up_trash", "seed": "1"}, "seed: should be a whole number, not '1'"),
        ({"task": "picking_up_trash", "dry": False, "policy": "experrt"}, "Did you mean 'expert'?"),
        ({}, "wants a task"),
    ],
)
def test_nothing_that_is_asked_of_a_run_is_passed_over(given: dict[str, Any], why: str, tmp_path: Path) -> None:
    """What would have no effect, or not the one that is meant, is refused; nothing is begun."""

    async def ask(client: Client) -> None:
        assert why in (await call(client, "run", **given))["error"]

    asked(tmp_path, ask, allow_motion=True)
    assert not list(tmp_path.iterdir())


RAW = [
    "pydantic",
    "validation error",
    "input_type",
    "Input should",
    "a valid",
    "Error executing",
    "Traceback",
    "_type=",
    "mpvi_bt/",
]
ODD: list[Any] = [
    None, "", " ", "x" * 5000, -1, 1e308, 10**30, True, [], {}, [[["deep"]]], {"a": {"b": 1}}, "\x00", "\ud800",
    "&a [*a]",
    "null", "[1]", '{"tree": 1}', "../../etc/passwd", "--help", "tree: t\nroot: {wiat: 2}", {"": []}, {"word": None},
]  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
def test_what_a_schema_refuses_the_tool_refuses_in_our_words(word: str, tmp_path: Path) -> None:
    """Each odd value of each argument: no validator's own text, on one line, and within a thousand characters."""

    async def ask(client: Client) -> None:
        (tool,) = [tool for tool in (await client.list_tools()).tools if tool.name == word]
        good = {"task": "picking_up_trash"} if "task" in tool.input_schema.get("required", ()) else {}
        for name in tool.input_schema["properties"]:
            for odd in ODD:
                given = {**good, name: odd}
                try:
                    answer = await client.call_tool(word, given)
                except MCPError as error:
                    assert not any(raw in str(error) for raw in RAW), (given, error)
                    continue
                text = answer.content[0].text  # type: ignore[union-attr]
                valid = jsonschema.Draft202012Validator(tool.input_schema).is_valid(given)
                assert answer.is_error or valid, given
                if answer.is_error:
                    assert not any(raw in text for raw in RAW), (given, text)
                    assert text.isprintable(), (given, text)
                    assert len(text) < 1200, given

    asked(tmp_path, ask)


def malformed(seed: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Calls as no client should make them."""
    rng = random.Random(seed)
    values: list[Any] = [
        None,
        "",
        "x" * 5000,
        -1,
        1e308,
        True,
        [],
        {},
        [[["deep"]]],
        {"a": {"b": 1}},
        "\x00",
        "&a [*a]",
    ]
    names = [
        "task",
        "tree",
        "plan",
        "parameters",
        "run",
        "wait_s",
        "dry",
        "instance",
        "seed",
        "policy",
        "on_failure",
        "nonsense",
    ]
    while True:
        yield (
            rng.choice([*WORDS, "shell", ""]),
            {name: rng.choice(values) for name in rng.sample(names, rng.randrange(1, 5))},
        )


@pytest.mark.slow
def test_a_thousand_malformed_calls_break_nothing(tmp_path: Path) -> None:
    """Each gets an answer, none starts a run, and the server answers as before."""

    async def ask(client: Client) -> None:
        calls = malformed(0)
        for _ in range(1000):
            tool, given = next(calls)
            try:
                await client.call_tool(tool, given)
            except Exception as error:
                assert "MCPError" in type(error).__name__, error
        assert len((await client.list_tools()).tools) == 9

    asked(tmp_path, ask)


def test_garbage_on_stdin_breaks_nothing(tmp_path: Path) -> None:
    """Lines that are no JSON, no message or a message of nothing known: the next good one is answered."""
    rng = random.Random(1)
    lines = [
        "{",
        "[]",
        "null",
        '{"jsonrpc": "2.0"}',
        '{"jsonrpc": "2.0", "id": 1, "method": "x"}',
        "\x01\x02",
        "[" * 999,
    ]
    hello = {
        "jsonrpc": "2.0", "id": 7, "method": "initialize",
        "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "t", "version": "1"}},
    }  # fmt: skip
    said = "".join(rng.choice(lines) + "\n" for _ in range(300)) + json.dumps(hello) + "\n"
    process = subprocess.Popen(
        [*MPVI, "mcp"],
        cwd=tmp_path,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(said)
    process.stdin.flush()
    for line in process.stdout:
        if json.loads(line).get("id") == 7:
            break
    else:
        raise AssertionError("no answer")
    process.stdin.close()
    assert process.wait(30) == 0


@pytest.mark.slow
def test_both_transports_answer(tmp_path: Path) -> None:
    """Over stdin and stdout, and over HTTP, the client lists the tools; when the server ends its runs end with it."""

    async def over_stdio() -> None:
        command = StdioServerParameters(
            command=sys.executable, args=[*MPVI[1:], "mcp"], cwd=tmp_path, env=dict(os.environ)
        )
        async with Client(stdio_client(command)) as client:
            assert len((await client.list_tools()).tools) == 9
            await call(client, "run", tree=FOREVER)
            while (await call(client, "progress"))["state"] == "starting":
                await anyio.sleep(0.1)

    anyio.run(over_stdio)
    trace = next((tmp_path / "runs" / "mcp" / "1").glob("*.trace.jsonl"))
    end = time.monotonic() + 30
    while '"end"' not in trace.read_text(encoding="utf-8").splitlines()[-1]:
        assert time.monotonic() < end
        time.sleep(0.1)

    async def over_http(url: str) -> None:
        async with Client(streamable_http_client(url)) as client:
            assert len((await client.list_tools()).tools) == 9

    with serving("mcp", "--serve=0", cwd=tmp_path) as (url, _):
        anyio.run(over_http, url)


@pytest.mark.slow
@pytest.mark.render
def test_an_agent_moves_the_robot(tmp_path: Path) -> None:
    """With leave a real episode is run, and can be stopped on the way; its trace says so."""

    async def ask(client: Client) -> None:
        run = (await call(client, "run", task="picking_up_trash", dry=False))["run"]
        while (await call(client, "progress", wait_s=2))["time_s"] < 1:
            pass
        assert "interrupted" in (await call(client, "stop", run=run))["outcome"]

    asked(tmp_path, ask, allow_motion=True)
