"""Wings and rooms of the package, in order: `python -m tests.rooms` writes the table in CONTRIBUTING.md."""

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

# What stands on what, from the ground up. A wing imports wings of earlier lines alone. In a wing, a room (or a lone
# module) imports itself and those of earlier lines; those of one line do not know each other.
WINGS: dict[str, tuple[tuple[str, ...], ...]] = {
    "ground": (
        ("errors", "version"),
        ("yaml_reader", "compiled", "import_paths", "near_file", "standard_streams", "moved"),
        ("file_kinds", "malformed"),
        ("geometry", "words", "paths", "marked_yaml", "marked_xml", "writing", "proxies"),
        ("robot", "extras", "cost"),
        ("protocols", "human", "torch_training"),
        ("action_chunk",),
    ),
    "executive": (
        ("language", "monitors"),
        ("plan", "completion"),
        ("rehearsal", "actions", "behaviors", "remote"),
        ("tree",),
        ("drawing", "btcpp"),
        ("trace", "ticking"),
    ),
    "finding": (("perception", "shapes"), ("scene", "eyes"), ("navigation",)),
    "hands": (("robots", "behavior_robot", "stance"), ("motion", "learned"), ("skills",), ("policies",)),
    "house": (
        ("states",),
        ("goals",),
        ("things", "truth"),
        ("generated",),
        ("layout", "imported"),
        ("sim",),
        ("instances",),
        ("maniskill",),
    ),
    "runs": (
        ("recording", "disturbances"),
        ("datasets", "symbolic"),
        ("choices",),
        ("episode",),
        ("suite", "serving"),
        ("ros2",),
        ("report",),
    ),
    "testing": (("doubles", "full_hands", "label_segmenter"), ("contracts", "scene_builder")),
    "apps": (("authoring",), ("api", "watch"), ("mcp_server",), ("cli",)),
}
RANK = {
    f"{wing}/{room}": (place, rank)
    for place, (wing, rows) in enumerate(WINGS.items())
    for rank, rooms in enumerate(rows)
    for room in rooms
}


def room_of(path: Path) -> str:
    """The room or lone module of a file, such as "house/sim" or "ground/errors"; "" for what only opens a wing."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if parts[-1] == "__init__" and len(parts) < 3 else "/".join(parts[:2])


@cache
def parsed(path: Path) -> ast.Module:
    """A file's syntax."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Full names of the modules that a file imports anywhere, at the top or inside a function."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            assert node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def rooms_imported(path: Path) -> Iterator[str]:
    """The rooms of ours that a file imports from."""
    for name in imports(path):
        if name.startswith("mpvi_bt.") and (room := "/".join(name.split(".")[1:3])) in RANK:
            yield room


def table() -> str:
    """The rooms of each wing from the command line down, as a Markdown table."""
    lines = ["| room | contents | stands on |", "|---|---|---|"]
    for wing, rows in reversed(WINGS.items()):
        lines.append(f"| **`{wing}/`** | **{_about(wing)}** | |")
        for rooms in reversed(rows):
            for room in rooms:
                if _has_modules(f"{wing}/{room}"):
                    below = ", ".join(_right_below(f"{wing}/{room}"))
                    lines.append(f"| `{wing}/{room}` | {_about(f'{wing}/{room}')} | {below} |")
    return "\n".join(lines) + "\n"


def _has_modules(room: str) -> bool:
    """Whether it is a folder with modules of its own."""
    return any(path.name != "__init__.py" for path in (PACKAGE / room).glob("*.py"))


def _about(room: str) -> str:
    """The first paragraph of the docstring of a wing or room."""
    text = ast.get_docstring(parsed(PACKAGE / room / "__init__.py"))
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
    return sorted(right, key=lambda name: (*(-place for place in RANK[name]), name))


def weight(files: Sequence[Path]) -> tuple[int, int, int, int]:
    """Files, lines, lines of code and lines of docstrings; blank lines and comments are neither of the last two."""
    total = code = docs = 0
    for path in files:
        tree = parsed(path)
        inside = set[int]()
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
                first = node.body[0]
                if (
                    isinstance(first, ast.Expr)
                    and isinstance(first.value, ast.Constant)
                    and isinstance(first.value.value, str)
                ):
                    inside |= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
        lines = path.read_text(encoding="utf-8").splitlines()
        total, docs = total + len(lines), docs + len(inside)
        code += sum(
            bool(text.strip()) and not text.strip().startswith("#") and number not in inside
            for number, text in enumerate(lines, 1)
        )
    return len(files), total, code, docs


def page() -> str:
    """CONTRIBUTING.md with the table as it is now."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return head + BEGIN + table() + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"{'wing':<10} {'files':>6} {'lines':>7} {'code':>7} {'docstrings':>11}")
    for name in (*WINGS, ""):
        files, total, code, docs = weight(sorted((PACKAGE / name).rglob("*.py")))
        print(f"{name or 'all':<10} {files:>6} {total:>7} {code:>7} {docs:>11}")
