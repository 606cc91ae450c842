"""A leaf of a file that no kind of node here stands for, with its ports."""

from __future__ import annotations

from dataclasses import dataclass, field

from mpvi_bt.executive.behaviors.parameters import Value


@dataclass
class PortOf:
    """A port of a placeholder.

    Attributes:
        parameter: Its name here.
        direction: "input_port", "output_port" or "inout_port".
        type: In C++, as the file declares it, or "".
        default: What it is where a node leaves it out; None: nothing.
        must: Every node gives it.
    """

    parameter: str
    direction: str = "input_port"
    type: str = ""
    default: Value | None = None
    must: bool = True


@dataclass
class Placeholder:
    """A leaf that nobody knows here.

    Attributes:
        tag, kind: Its ID there, and its kind here.
        line: Where the file has the first.
        ports: By their names there.
    """

    tag: str
    kind: str
    line: int
    ports: dict[str, PortOf] = field(default_factory=dict)
