"""The rooms of the package and their order: `python -m tests.rooms` draws the table in CONTRIBUTING.md."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import mpvi_bt

PACKAGE = Path(mpvi_bt.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
PAGE = PACKAGE.parent / "CONTRIBUTING.md"
BEGIN, END = "<!-- rooms -->\n", "<!-- end of rooms -->\n"

# What stands on what, from the ground up. A room (or single module) imports itself and those of earlier lines; those of
# one line do not know each other.
ORDER = (
    ("errors", "version"),
    ("yaml_reader", "compiled", "import_paths", "standard_streams"),
    ("file_kinds",),
    ("robot", "paths", "marked_yaml", "writing", "proxies"),
    ("extras", "cost"),
    ("protocols",),
    ("action_chunk", "action_rows", "monitors"),
    ("base_ramp",),
    ("language", "rules"),
    ("goals", "perception", "shapes"),
    ("plan",),
    ("scene",),
    ("things",),
    ("house",),
    ("navigation", "manipulation/stance", "learned", "completion", "remote", "sim"),
    ("manipulation/motion", "behaviors", "instances"),
    ("manipulation/skills",),
    ("manipulation/policies", "manipulation"),
    ("tree", "maniskill", "disturbances"),
    ("testing", "drawing", "btcpp"),
    ("trace",),
    ("executive",),
    ("recording",),
    ("choices",),
    ("episode",),
    ("suite", "datasets", "serving", "authoring"),
    ("report",),
    ("watch",),
    ("api",),
    ("mcp_server",),
    ("cli",),
)
RANK = {room: rank for rank, rooms in enumerate(ORDER) for room in rooms}


def room_of(path: Path) -> str:
    """The room or top module that a file belongs to, such as "sim" or "manipulation/skills"."""
    return _room(path.relative_to(PACKAGE).with_suffix("").parts)


def _room(parts: Sequence[str]) -> str:
    inner = "/".join(parts[:2])
    return inner if inner in RANK else parts[0]


def imports(path: Path) -> Iterator[str]:
    """Full names of the modules that a file imports anywhere, at the top or inside a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            assert node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def rooms_imported(path: Path) -> Iterator[str]:
    """The rooms of ours that a file imports from."""
    for name in imports(path):
        if name.startswith("mpvi_bt.") and (room := _room(name.split(".")[1:])) in RANK:
            yield room


def table() -> str:
    """The rooms from the command line down, as a Markdown table."""
    lines = ["| room | contents | stands on |", "|---|---|---|"]
    for rooms in reversed(ORDER):
        for room in rooms:
            if _has_modules(room):
                lines.append(f"| `{room}` | {_about(room)} | {', '.join(_right_below(room))} |")
    return "\n".join(lines) + "\n"


def _has_modules(room: str) -> bool:
    """Whether it is a folder with modules of its own."""
    return any(path.name != "__init__.py" for path in (PACKAGE / room).glob("*.py"))


def _about(room: str) -> str:
    """The first paragraph of the room's docstring."""
    text = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))
    assert text, f"{room}/__init__.py has no docstring"
    return " ".join(text.split("\n\n")[0].split())


@cache
def _imported(room: str) -> frozenset[str]:
    """The other rooms that this one imports."""
    names = {name for path in MODULES if room_of(path) == room for name in rooms_imported(path)} - {room}
    return frozenset(filter(_has_modules, names))


@cache
def _all_below(room: str) -> frozenset[str]:
    """The rooms that this one imports, and those that they import, down to the ground."""
    return _imported(room).union(*map(_all_below, _imported(room)))


def _right_below(room: str) -> list[str]:
    """The rooms that this one imports and that it would not reach through another, highest first."""
    direct = _imported(room)
    right = direct - frozenset().union(*map(_all_below, direct))
    return sorted(right, key=lambda name: (-RANK[name], name))


def page() -> str:
    """CONTRIBUTING.md with the table as it is now."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return head + BEGIN + table() + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
