"""The tools behind the protocol, by the official SDK."""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable
from typing import Any

from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ResourceError, ToolError
from mcp.server.transport_security import TransportSecuritySettings
from mcp_types import ToolAnnotations
from starlette.types import ASGIApp

import mpvi_bt
from mpvi_bt.apps.mcp_server.answers import RunProgress
from mpvi_bt.apps.mcp_server.strict_tool import StrictTool
from mpvi_bt.apps.mcp_server.tools import Tools
from mpvi_bt.ground.errors import MpviError, UnknownName

_LOOKS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
_MOVES = ToolAnnotations(read_only_hint=False, destructive_hint=True, idempotent_hint=False, open_world_hint=True)
_ENDS = ToolAnnotations(read_only_hint=False, destructive_hint=True, idempotent_hint=True, open_world_hint=False)
_INSTRUCTIONS = """\
mpvi_bt runs behavior trees on a mobile manipulator, or dry, with nothing moving. The way to go: tasks, scene and plan
say what there is; write a tree (the resource mpvi://schema/tree is its schema); check and preview it; run it dry; run
it; progress says how far it is, explain why it failed. One run at a time."""


def make_server(tools: Tools) -> MCPServer[Any]:
    """The server of some tools, on no transport yet."""
    looks = (tools.tasks, tools.scene, tools.plan, tools.check, tools.preview, tools.explain)
    server = _ToolServer(
        "mpvi_bt",
        instructions=_INSTRUCTIONS,
        version=mpvi_bt.__version__,
        log_level="ERROR",
        tools=[
            *(StrictTool.of(_told(tool), _LOOKS) for tool in looks),
            StrictTool.of(_told(tools.run), _MOVES),
            StrictTool.of(_told(tools.stop), _ENDS),
            StrictTool.of(_progress(tools), _LOOKS),
        ],
    )
    _add_resources(server, tools)
    return server


class _ToolServer(MCPServer[Any]):
    """The SDK's server, with the nearest name for an unknown tool."""

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
        known = [tool.name for tool in await self.list_tools()]
        if name not in known:
            raise ToolError(str(UnknownName("tool", name, known)))
        return await super().call_tool(name, arguments, context)


def _progress(tools: Tools) -> Callable[..., Any]:
    """The tool that reports progress while it waits."""

    async def progress(ctx: Context, run: str | None = None, wait_s: float = 0.0) -> RunProgress:
        try:
            return await tools.progress(ctx.report_progress, run, wait_s)
        except MpviError as error:
            raise ToolError(str(error)) from None

    progress.__doc__ = tools.progress.__doc__
    given = inspect.get_annotations(tools.progress, eval_str=True)
    progress.__annotations__ = {"ctx": Context, **{n: given[n] for n in ("run", "wait_s", "return")}}
    return progress


def over_http(server: MCPServer[Any]) -> ASGIApp:
    """The app at /mcp, unguarded: access is checked by a `watch.guard.PageGuard`."""
    unguarded = TransportSecuritySettings(enable_dns_rebinding_protection=False)
    return server.streamable_http_app(streamable_http_path="/mcp", transport_security=unguarded)


def _told(tool: Callable[..., Any]) -> Callable[..., Any]:
    """The same, its errors told to the client as the command line would tell them."""

    @functools.wraps(tool)
    def told(*args: Any, **given: Any) -> Any:
        try:
            return tool(*args, **given)
        except MpviError as error:
            raise ToolError("; ".join(str(error).splitlines())) from None

    told.__annotations__ = inspect.get_annotations(tool, eval_str=True)
    return told


def _add_resources(server: MCPServer[Any], tools: Tools) -> None:
    @server.resource("mpvi://schema/tree", mime_type="application/schema+json")
    def tree_schema() -> str:
        """JSON Schema of trees, with every node of every installed package."""
        from mpvi_bt.executive.tree.json_schema import schema_text

        return schema_text("tree")

    @server.resource("mpvi://schema/plan", mime_type="application/schema+json")
    def plan_schema() -> str:
        """JSON Schema of plans."""
        from mpvi_bt.executive.plan.schema import Plan

        return json.dumps(Plan.model_json_schema(), indent=1)

    @server.resource("mpvi://tasks", mime_type="application/json")
    def all_tasks() -> str:
        """What can be asked for: tasks, skills and trees."""
        return tools.tasks().model_dump_json(indent=1)

    @server.resource("mpvi://runs/{run}/trace", mime_type="application/jsonl")
    def trace(run: str) -> str:
        """The trace of a run: its events tick by tick, and the record of all motion."""
        try:
            return tools.trace(run)
        except MpviError as error:
            raise ResourceError(str(error)) from None
