"""A plot as SVG, put together from shapes and escaped text; `page/plots.css` says how its classes look."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from html import escape
from importlib import resources

from mpvi_bt.executive.drawing.cells import columns, cut, one_line

COLORS = 8  # m0 to m7 in plots.css; further methods begin anew with m1


class Drawing:
    """Shapes, in the order of drawing; places in pixels from the upper left corner."""

    def __init__(self, title: str, width: float) -> None:
        self.title, self.width = title, width
        self._parts: list[str] = []

    def rect(self, x: float, y: float, width: float, height: float, look: str, title: str = "") -> None:
        """A filled rectangle, with a tooltip if there is a title."""
        told = f"<title>{escape(one_line(title))}</title>" if title else ""
        box = f'<rect class="{look}" x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{max(height, 0):.1f}"'
        self._parts.append(f"{box}>{told}</rect>" if told else f"{box}/>")

    def line(self, x0: float, y0: float, x1: float, y1: float, look: str) -> None:
        """A straight line."""
        self._parts.append(f'<path class="{look}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>')

    def dot(self, x: float, y: float, radius: float, look: str) -> None:
        """A disc."""
        self._parts.append(f'<circle class="{look}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>')

    def diamond(self, x: float, y: float, radius: float, look: str) -> None:
        """A square that stands on a corner."""
        self._parts.append(f'<path class="{look}" d="M{x - radius:.1f} {y:.1f}l{radius:g} {-radius:g} {radius:g} '
                           f'{radius:g} {-radius:g} {radius:g}z"/>')  # fmt: skip

    def hatch(self, x: float, y: float, width: float, height: float) -> None:
        """Diagonal lines over a rectangle."""
        steps = range(int((width + height) // 6) + 1)
        ends = [(max(0.0, 6.0 * k - height), min(6.0 * k, width), 6.0 * k) for k in steps]
        lines = "".join(f"M{x + a:.1f} {y + k - a:.1f}L{x + b:.1f} {y + k - b:.1f}" for a, b, k in ends if b > a)
        self._parts.append(f'<path class="hatch" d="{lines}"/>')

    def text(
        self, x: float, y: float, text: str, look: str = "", anchor: str = "start", room: float | None = None
    ) -> None:
        """Text on a baseline at y, cut to what fits into `room`."""
        shown = one_line(text) if room is None else cut(one_line(text), int(room / 6.4))
        told = f"<title>{escape(one_line(text))}</title>" if shown != one_line(text) else ""
        look = f' class="{look}"' if look else ""
        end = f' text-anchor="{anchor}"' if anchor != "start" else ""
        self._parts.append(f'<text{look} x="{x:.1f}" y="{y:.1f}"{end}>{escape(shown)}{told}</text>')

    def legend(self, y: float, entries: list[tuple[str, str]]) -> float:
        """Swatches with words, in as many rows as they take.

        Args:
            y: Upper edge.
            entries: Class of the swatch, or "diamond", and its word.

        Returns:
            Lower edge.
        """
        x = 0.0
        for look, word in entries:
            wide = 20 + 6.6 * columns(word) + 16
            if x and x + wide > self.width:
                x, y = 0.0, y + 20
            if look == "diamond":
                self.diamond(x + 6, y + 8, 4.5, "theirs")
            else:
                self.rect(x, y + 2, 12, 12, look.removesuffix(" hatched"))
                if look.endswith(" hatched"):
                    self.hatch(x, y + 2, 12, 12)
            self.text(x + 18, y + 12, word, "small")
            x += wide
        return y + 20

    def svg(self, height: float, alone: bool = False) -> str:
        """The drawing.

        Args:
            height: Of it.
            alone: It stands in a file of its own, so that it has to bring its looks.
        """
        style = f"<style>{plot_style()}</style>" if alone else ""
        size = f'width="{self.width:.0f}" height="{height:.0f}" viewBox="0 0 {self.width:.0f} {height:.0f}"'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="plot" role="img" {size}>'
            f"<title>{escape(one_line(self.title))}</title>{style}{''.join(self._parts)}</svg>"
        )


def plot_style() -> str:
    """How the classes of plots look."""
    return (resources.files("mpvi_bt.runs.report") / "page" / "plots.css").read_text(encoding="utf-8")


def method_colors(methods: Sequence[str], baseline: str) -> list[str]:
    """Class of the color of each method: gray for the baseline where others stand beside it, and for no other."""
    others = itertools.count()
    alone = len(methods) == 1
    return ["m0" if name == baseline and not alone else f"m{1 + next(others) % (COLORS - 1)}" for name in methods]
