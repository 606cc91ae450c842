"""A tool that accepts only arguments of its schema and reports errors in our words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.tools import Tool
from mcp.server.mcpserver.utilities.func_metadata import FuncMetadata
from mcp_types import ToolAnnotations

from mpvi_bt.ground.errors import FileProblems, Problem, bounded
from mpvi_bt.ground.marked_yaml import validate_data
from mpvi_bt.ground.yaml_reader import SourceMarks

_LONGEST = 1000  # characters of a message about arguments; Our choice: an agent pays for each


class _AsSent(FuncMetadata):
    """Arguments as a client sends them: the SDK would read a tree that is JSON, or the text "null", as data."""

    def pre_parse_json(self, data: dict[str, Any]) -> dict[str, Any]:
        return data


class StrictTool(Tool):
    """A tool of the SDK's, with its arguments held to their schema."""

    @classmethod
    def of(cls, function: Callable[..., Any], annotations: ToolAnnotations) -> StrictTool:
        """The tool that a function is."""
        tool = cls.from_function(function, annotations=annotations)
        takes = tool.fn_metadata.arg_model
        config: Any = takes.model_config
        config.update(extra="forbid", strict=True)
        takes.model_rebuild(force=True)
        given = {name: getattr(tool.fn_metadata, name) for name in FuncMetadata.model_fields}
        changed = {"fn_metadata": _AsSent(**given), "parameters": takes.model_json_schema()}
        return cast("StrictTool", tool.model_copy(update=changed))

    async def run(self, arguments: dict[str, Any], context: Any, convert_result: bool = False) -> Any:
        """As the SDK's.

        Raises:
            ToolError: In our words: what is wrong with the arguments, or what the tool refuses.
        """
        try:
            validate_data(arguments, SourceMarks.unplaced(arguments, self.name), self.fn_metadata.arg_model)
        except FileProblems as error:
            raise ToolError(bounded("; ".join(map(_told, error.problems)), _LONGEST)) from None
        try:
            return await super().run(arguments, context, convert_result)
        except ToolError as error:
            raise error.__cause__ if type(error.__cause__) is ToolError else error from None


def _told(problem: Problem) -> str:
    """A problem of an argument, with its place; at the top, keys are called arguments."""
    place = problem.pointer.lstrip("/")
    message = problem.message
    if "/" not in place:
        message = message.replace("unknown key", "unknown argument", 1).replace("missing key", "missing argument", 1)
    return message if problem.code in ("unknown-key", "missing-key") else f"{place}: {message}"
