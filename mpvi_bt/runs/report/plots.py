"""Two plots in the paper's form: the gain on each task, and every method's q on each task."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator

from mpvi_bt.runs.report.compare import SAME_Q, MethodComparison, TaskPairs
from mpvi_bt.runs.report.figures import Figures, Group, MethodFigures
from mpvi_bt.runs.report.plot_svg import Drawing, method_colors

WIDE, NARROW = 832, 316  # pixels: of a page, and of a telephone
_ROW, _LABEL, _VALUE = 22.0, 270.0, 52.0
_BAR, _GAP, _PANEL, _AXIS, _SPARE = 16.0, 4.0, 112.0, 150.0, 26.0
_Bar = tuple[Group | None, list[float], float | None]  # of a method, its points, and the paper's mean


def improvement_plot(comparison: MethodComparison, width: int = WIDE, alone: bool = False) -> str:
    """Each task's difference of q, sorted: gains blue, regressions red, hatched where the baseline had nothing.

    Paper, Experiments: the figure of task progress over the baseline.

    Args:
        comparison: Of a method with its baseline.
        width: In pixels; names stand above their bars where it is narrow.
        alone: It is to be a file of its own.
    """
    narrow = width < _LABEL * 2
    drawing = Drawing(f"Change of q on each task, {comparison.method} less {comparison.baseline}", width)
    tasks = sorted(comparison.tasks.items(), key=lambda item: (-item[1].difference.mean, item[0]))
    marks = [("gain", f"gain ({comparison.gains})"), ("same", f"equal ({comparison.equal})"),
             ("loss", f"regression ({comparison.regressions})"),
             ("gain hatched", f"{comparison.baseline} had q = 0")]  # fmt: skip
    y = drawing.legend(0, marks) + 6
    left, right = (4.0 if narrow else _LABEL), width - _VALUE
    ends = [bound for _, pairs in tasks for bound in _ends(pairs)]
    low, high = min(0.0, *ends), max(0.0, *ends)
    if high - low < SAME_Q:
        high = 1.0
    left += _VALUE if low < 0 else 0

    def px(change: float) -> float:
        return left + (change - low) / (high - low) * (right - left)

    tall = _ROW + (14 if narrow else 0)
    bottom = y + tall * len(tasks)
    for tick in _ticks(low, high):
        drawing.line(px(tick), y, px(tick), bottom, "grid")
        drawing.text(px(tick), bottom + 14, f"{tick:+.1f}" if tick else "0", "dim small", "middle")
    drawing.line(px(0), y, px(0), bottom, "axis")
    for task, pairs in tasks:
        if narrow:
            drawing.text(0, y + 12, task, "small over", room=width)
        else:
            drawing.text(0, y + 15, task, room=_LABEL - 12)
        _change(drawing, px, y + tall - _ROW + 4, pairs)
        y += tall
    return drawing.svg(bottom + 22, alone)


def method_plot(figures: Figures, width: int = WIDE, alone: bool = False) -> str:
    """A panel for every task, and one for all: a bar for each method up to its mean q, and its instances as points.

    Paper, Experiments: the figure of the ablation study, which leaves tasks out on which all methods have nothing. A
    diamond is the paper's mean of the method of that name.
    """
    drawing = Drawing("q of every method on each task", width)
    methods = figures.methods
    colors = method_colors([method.name for method in methods], figures.baseline)
    marks = [(color, method.name) for color, method in zip(colors, methods, strict=True)]
    if any(figures.paper.get(method.name) for method in methods):
        marks.append(("diamond", "the paper's"))
    y = drawing.legend(0, marks) + 14
    bars: list[_Bar] = [(m.overall, _points(m), m.paper) for m in methods]
    panels = [("all tasks", bars)]
    for task in shown_tasks(figures):
        panels.append((task, [
            (m.tasks.get(task), list(m.instances.get(task, {}).values()), figures.paper.get(m.name, {}).get(task))
            for m in methods
        ]))  # fmt: skip
    wide = max(_PANEL, len(methods) * (_BAR + _GAP) + 16)
    across = max(1, int((width - _SPARE) // wide))
    labels = [_folded(name, int((wide - 8) / 6.4)) for name, _ in panels]
    tall = _AXIS + 26 + 13 * max(map(len, labels))
    for k, (_, bars) in enumerate(panels):
        x = _SPARE + (k % across) * wide
        if k and k % across == 0:
            y += tall
        _axis(drawing, x, y, wide, k % across == 0)
        start = x + (wide - 8 - len(methods) * (_BAR + _GAP) + _GAP) / 2
        for i, bar in enumerate(bars):
            _bar(drawing, start + i * (_BAR + _GAP), y, colors[i], bar, methods[i].name)
            if bar[0] is not None and not k:
                _interval(drawing, start + i * (_BAR + _GAP) + _BAR / 2, y, bar[0])
        for j, line in enumerate(labels[k]):
            look = "small" if k else "strong small"
            drawing.text(x + (wide - 8) / 2, y + _AXIS + 16 + 13 * j, line, look, "middle", room=wide)
    return drawing.svg(y + tall - 10, alone)


def shown_tasks(figures: Figures) -> list[str]:
    """Tasks on which any method has a point."""
    return [
        task
        for task in figures.tasks
        if any(any(method.instances.get(task, {}).values()) for method in figures.methods)
    ]


def _ends(pairs: TaskPairs) -> Iterator[float]:
    found = pairs.difference
    yield from (x for x in (found.mean, found.low, found.high) if x is not None)


def _ticks(low: float, high: float) -> list[float]:
    step = 0.1 if high - low <= 0.6 else 0.2 if high - low <= 1.2 else 0.5
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _change(drawing: Drawing, px: Callable[[float], float], y: float, pairs: TaskPairs) -> None:
    """One bar with its interval and its number."""
    change = pairs.difference
    look = "gain" if change.mean > SAME_Q else "loss" if change.mean < -SAME_Q else "same"
    a, b = sorted((px(0), px(change.mean)))
    if look == "same":
        a, b = a - 1.5, a + 1.5
    tall = _ROW - 8
    drawing.rect(a, y, b - a, tall, look, f"{pairs.baseline:.3f} to {pairs.method:.3f}, {pairs.pairs} pairs")
    if pairs.baseline <= SAME_Q and look != "same":
        drawing.hatch(a, y, b - a, tall)
    if change.low is not None and change.high is not None and change.high > change.low:
        a, b = min(a, px(change.low)), max(b, px(change.high))
        drawing.line(px(change.low), y + tall / 2, px(change.high), y + tall / 2, "span")
    number = "0" if look == "same" else f"{change.mean:+.2f}"
    if change.mean < -SAME_Q:
        drawing.text(a - 6, y + 11, number, "small", "end")
    else:
        drawing.text(b + 6, y + 11, number, "small")


def _axis(drawing: Drawing, x: float, y: float, wide: float, named: bool) -> None:
    for share in (0.0, 0.5, 1.0):
        at = y + _AXIS * (1 - share)
        drawing.line(x, at, x + wide - 8, at, "grid" if share else "axis")
        if named:
            drawing.text(x - 6, at + 4, f"{share:g}", "dim small", "end")


def _points(method: MethodFigures) -> list[float]:
    """The values behind the overall mean: means of tasks, or instances if there is only one task."""
    tasks = [list(instances.values()) for instances in method.instances.values()]
    return tasks[0] if len(tasks) == 1 else [sum(scores) / len(scores) for scores in tasks if scores]


def _bar(drawing: Drawing, x: float, y: float, look: str, bar: _Bar, method: str) -> None:
    """A method's bar in a panel; nothing where it has no result."""
    group, points, paper = bar
    q = group.measures["q_score"] if group else None

    def at(share: float) -> float:
        return y + _AXIS * (1 - share)

    if group is not None and q is not None:
        told = f"{method}: {q.mean:.3f}, {group.successes} of {group.finished} succeeded"
        drawing.rect(x, at(q.mean), _BAR, _AXIS * q.mean, f"{look} bar", told)
        for value, count in Counter(points).items():
            apart = min(4.0, (_BAR - 4) / count)
            for j in range(count):
                drawing.dot(x + _BAR / 2 + (j - (count - 1) / 2) * apart, at(value), 1.7, "dot")
        drawing.line(x - 1.5, at(q.mean), x + _BAR + 1.5, at(q.mean), "mean")
    elif group is not None:
        drawing.text(x + _BAR / 2, at(0) - 5, "-", "dim small", "middle")
    if paper is not None:
        drawing.diamond(x + _BAR / 2, at(paper), 4, "theirs")


def _interval(drawing: Drawing, x: float, y: float, group: Group) -> None:
    """The confidence interval of a mean."""
    q = group.measures["q_score"]
    if q is not None and q.low is not None and q.high is not None and q.high > q.low:
        drawing.line(x, y + _AXIS * (1 - q.low), x, y + _AXIS * (1 - q.high), "span")


def _folded(name: str, room: int) -> list[str]:
    """A name in at most three lines, broken behind underscores where it can be."""
    lines = [""]
    for word in re.findall(r"[^_ ]*[_ ]?", name):
        if lines[-1] and len(lines[-1]) + len(word.rstrip("_ ")) > room:
            lines.append("")
        lines[-1] += word
    return [*lines[:2], "".join(lines[2:])] if len(lines) > 3 else lines
