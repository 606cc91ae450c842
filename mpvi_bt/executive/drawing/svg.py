"""A tree as a self-contained SVG: boxes from top to bottom, titles as tooltips.

Our choice of layout: the block of a node is its box with its children's blocks below, side by side; blocks that would
make a row wider than a page go on in a next row, as words do, and hang from a spine at the left. So a tree of a hundred
nodes is as wide as a page, and reads from left to right and from top to bottom.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

from mpvi_bt.executive.drawing.cells import columns, cut, one_line, wrapped
from mpvi_bt.executive.drawing.symbols import MARKS, sign, standing
from mpvi_bt.executive.drawing.text import time_text
from mpvi_bt.executive.tree.spec import Placed, TreeSpec
from mpvi_bt.executive.tree.state import NodeState

# All in pixels.
_LINE = 1400.0  # blocks side by side
_MARGIN, _BESIDE, _BELOW, _INDENT = 20.0, 14.0, 26.0, 22.0
_FONT, _SMALL, _LEADING, _PAD_X, _PAD_Y = 12.0, 10.0, 15.0, 11.0, 6.0
_COLUMNS, _LINES = 24, 4  # of a label

# Widths of Helvetica's letters in thousandths of the font's size; what is not named is as wide as "e", or twice.
_WIDTHS = {c: w for letters, w in [("ijl|'", 230), ("ftI.,:;!/\\ []()`", 290), ("r-{}\"*", 350), ("ckszxyvJ?", 510),
           ("ABEFGHKNPRSUVXYZTLCDOQ&w+<>=~", 700), ("mMW%@", 880)] for c in letters}  # fmt: skip

_STYLE = """\
svg{font:12px Helvetica,Arial,sans-serif;background:#fff}
path{fill:none;stroke:#9aa2ae;stroke-width:1.2}
.s{font-size:10px;opacity:.85}
@media(prefers-color-scheme:dark){svg{background:#15181d}path{stroke:#5d6672}}
"""


@dataclass
class _Block:
    """A node's box with everything below it; places are of the block's upper left corner, then of the drawing's."""

    lines: list[str]
    notes: list[str]
    box: tuple[float, float]  # width and height
    size: tuple[float, float]
    left: float = 0.0  # of the box within the block
    rows: list[list[_Block]] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0

    @property
    def middle(self) -> float:
        return self.x + self.left + self.box[0] / 2


def svg_tree(tree: TreeSpec, states: Mapping[str, NodeState] | None = None) -> str:
    """The tree as SVG: composites are boxes, decorators have pointed sides, leaves round ones.

    Args:
        tree: What to draw.
        states: By path; they color the boxes and add marks, times and feedback.
    """
    blocks: dict[str, _Block] = {}
    for node in reversed(tree.nodes):
        state = states.get(node.path, NodeState()) if states is not None else None
        blocks[node.path] = _arranged(_measured(node, state), [blocks[child] for child in node.children])
    root = blocks[tree.nodes[0].path]
    root.x = root.y = _MARGIN
    edges: list[str] = []
    boxes: list[str] = []
    for node in tree.nodes:
        block = blocks[node.path]
        _place(block)
        edges += _edges(block)
        boxes.append(_drawn(node, block, states.get(node.path, NodeState()) if states is not None else None))
    width, height = root.size[0] + 2 * _MARGIN, root.size[1] + 2 * _MARGIN
    name = escape(one_line(": ".join(filter(None, (tree.name, tree.instruction)))))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="0 0 {width:.0f} {height:.0f}" role="img">',
            f"<title>{name}</title>",
            f"<style>{_STYLE}</style>",
            *([f'<path d="{"".join(edges)}"/>'] if edges else []),
            *boxes,
            "</svg>",
        ]
    )


def _width(text: str, size: float) -> float:
    """About what a browser makes of it, in pixels."""
    return sum(_WIDTHS.get(c, 560 if c.isascii() else 560 * columns(c)) for c in text) * size / 1000


def _measured(node: Placed, state: NodeState | None) -> _Block:
    """The block of a node alone."""
    family = node.spec.type.family
    before = [sign(node.spec)] if family == "composite" else []
    notes = []
    if state is not None:
        before.insert(0, MARKS[standing(state)].unicode)
        notes = [cut(note, _COLUMNS + 4) for note in (time_text(state), one_line(state.feedback)) if note]
    lines = wrapped(" ".join([*before, one_line(node.spec.label)]), _COLUMNS, _LINES)
    width = max(*(_width(line, _FONT) for line in lines), *(_width(note, _SMALL) for note in notes), 30.0)
    sides = 2 * _PAD_X + (_PAD_X if family == "decorator" else 0)
    box = (width + sides, _LEADING * len(lines) + (_LEADING - 2) * len(notes) + 2 * _PAD_Y)
    return _Block(lines, notes, box, box)


def _arranged(block: _Block, children: list[_Block]) -> _Block:
    """The block with its children's in rows below its box."""
    for child in children:
        row = block.rows[-1] if block.rows else None
        if row is None or sum(c.size[0] + _BESIDE for c in row) + child.size[0] > _LINE:
            block.rows.append(row := [])
        row.append(child)
    many = len(block.rows) > 1
    y, right = block.box[1], 0.0
    for row in block.rows:
        x = _INDENT if many else 0.0
        y += _BELOW
        for child in row:
            child.x, child.y = x, y
            x += child.size[0] + _BESIDE
        right = max(right, x - _BESIDE)
        y += max(child.size[1] for child in row)
    if len(block.rows) == 1:
        row = block.rows[0]
        block.left = (row[0].middle + row[-1].middle - block.box[0]) / 2
        if block.left < 0:
            for child in row:
                child.x -= block.left
            right, block.left = right - block.left, 0.0
    block.size = max(right, block.left + block.box[0]), y
    return block


def _place(block: _Block) -> None:
    """Turn the places of its children from its own frame into the drawing's."""
    for child in _children(block):
        child.x += block.x
        child.y += block.y


def _children(block: _Block) -> Iterator[_Block]:
    for row in block.rows:
        yield from row


def _edges(block: _Block) -> Iterator[str]:
    """From the box to each child: down its middle, or down the spine; along a line above the row; down."""
    many = len(block.rows) > 1
    start = block.x + _INDENT / 2 if many else block.middle
    for child in _children(block):
        along = child.y - _BELOW / 2
        turn = min(6.0, abs(child.middle - start) / 2)
        side = turn if child.middle > start else -turn
        corner = f"Q{start:.1f} {along:.1f} {start + side:.1f} {along:.1f}H{child.middle - side:.1f}" if turn else ""
        end = f"Q{child.middle:.1f} {along:.1f} {child.middle:.1f} {along + turn:.1f}" if turn else ""
        yield f"M{start:.1f} {block.y + block.box[1]:.1f}V{along - turn:.1f}{corner}{end}V{child.y:.1f}"


def _drawn(node: Placed, block: _Block, state: NodeState | None) -> str:
    mark = MARKS["idle" if state is None else standing(state)]
    x, y, (width, height) = block.x + block.left, block.y, block.box
    title = [node.path]
    if state is not None:
        title += [mark.word, *filter(None, (time_text(state), state.feedback, state.reason, state.evidence))]
    look = f'fill="{mark.fill}" stroke="{mark.ink}"'
    family = node.spec.type.family
    if family == "decorator":
        tip = _PAD_X
        points = [(x + tip, y), (x + width - tip, y), (x + width, y + height / 2), (x + width - tip, y + height)]
        points += [(x + tip, y + height), (x, y + height / 2)]
        shape = f'<polygon points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in points)}" {look}/>'
    else:
        round_px = 2 if family == "composite" else min(height / 2, 13.0)
        shape = f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{round_px:g}" {look}/>'
    texts, line_y = [], y + _PAD_Y - 4
    for text, small in [*((line, False) for line in block.lines), *((note, True) for note in block.notes)]:
        line_y += _LEADING - 2 * small
        style = ' class="s"' if small else ""
        texts.append(
            f'<text x="{x + width / 2:.1f}" y="{line_y:.1f}"{style} '
            f'fill="{mark.ink}" text-anchor="middle">{escape(text)}</text>'
        )
    return f"<g><title>{escape('; '.join(map(one_line, title)))}</title>{shape}{''.join(texts)}</g>"
