"""Which leaf of the tree ran when in an episode, from its trace."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape

from mpvi_bt.executive.drawing.cells import cut, one_line
from mpvi_bt.executive.drawing.symbols import MARKS, Standing, outcome
from mpvi_bt.executive.trace.read import Trace

MOST_ROWS = 40  # Our choice: the page of a suite holds hundreds of these
_LABEL = 80  # columns
_STEPS_S = (5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200)


@dataclass(frozen=True)
class Span:
    """A stretch of simulated time [s] in which a leaf ran, and how it stood then."""

    start_s: float
    end_s: float
    standing: Standing


@dataclass
class Row:
    """A leaf that ran.

    Attributes:
        label: Of its node.
        spans: In the order of time.
    """

    label: str
    spans: list[Span] = field(default_factory=list)


def timeline(trace: Trace) -> list[Row]:
    """Every leaf that ran, by start time; a leaf still active at the end is shown as running.

    Each stands as the tree has it: one that a node above it cut off, such as a timeout, was interrupted.
    """
    rows: dict[str, Row] = {}
    began: dict[str, float] = {}
    labels: dict[str, str] = {}
    tree = None
    end_s = 0.0
    for tick, moment in trace.moments():
        end_s = tick.time_s
        if moment.tree is not tree:
            tree = moment.tree
            labels = {n.path: n.spec.label for n in tree.nodes if n.spec.type.family == "leaf"}
        for path, state in tick.nodes.items():
            if path not in labels:
                continue
            if state.status == "RUNNING":
                began.setdefault(path, end_s)
                rows.setdefault(path, Row(one_line(labels[path])))
            elif path in began:
                rows[path].spans.append(Span(began.pop(path), end_s, outcome(state)))
        for path in began.keys() - labels.keys():  # its part of the tree was swapped
            rows[path].spans.append(Span(began.pop(path), end_s, "interrupted"))
    if trace.end is not None:
        end_s = trace.end.time_s
    for path, start_s in began.items():
        rows[path].spans.append(Span(start_s, end_s, "running"))
    return list(rows.values())


def timeline_html(rows: list[Row], end_s: float) -> str:
    """The rows over simulated time, as HTML that is as wide as its page; each says in a word how it came out.

    Args:
        rows: Of `timeline`; those beyond the first 40 are only counted.
        end_s: When the episode ended.
    """
    total = max([end_s, *(span.end_s for row in rows for span in row.spans), 1e-3])
    parts = []
    for row in rows[:MOST_ROWS]:
        last = row.spans[-1].standing
        boxes = "".join(_box(span, total, last) for span in row.spans)
        spent = sum(span.end_s - span.start_s for span in row.spans)
        parts.append(
            f'<div class="row" data-is="{last}"><span>{escape(cut(row.label, _LABEL))}</span><svg>{boxes}</svg>'
            f"<span>{MARKS[last].unicode} {MARKS[last].word} {spent:.1f} s</span></div>"
        )
    step = next((step for step in _STEPS_S if total / step <= 6), total)
    ticks = "".join(
        f'<text x="{k * step / total * 100:.1f}%" y="11">{k * step:g} s</text>' for k in range(int(total / step) + 1)
    )
    parts.append(f'<div class="row axis"><span></span><svg>{ticks}</svg><span></span></div>')
    if len(rows) > MOST_ROWS:
        parts.append(f'<p class="dim">and {len(rows) - MOST_ROWS} more that ran</p>')
    return f'<div class="timeline">{"".join(parts)}</div>'


def _box(span: Span, total: float, usual: Standing) -> str:
    """A stretch; it looks as its row does unless it stands otherwise."""
    x, width = span.start_s / total * 100, max((span.end_s - span.start_s) / total * 100, 0.3)
    look = f' data-is="{span.standing}"' if span.standing != usual else ""
    return f'<rect{look} x="{x:.1f}%" width="{width:.1f}%"/>'
