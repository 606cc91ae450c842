"""The networks' layers and sizes, which their training in torch and their running in numpy have in common.

A pyramid: each stage halves the picture, and what the coarse stages know is added to the finer ones (Lin and others
2017, feature pyramid networks). Each cell of 4 x 4 px then answers with its kind, what covers each of its pixels, how
near a thing's center is, and the way there (as in Panoptic-DeepLab, Cheng and others 2020). It tells furniture apart,
but not movable things: they are small, and a second, smaller network looks at a crop of each.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.finding.eyes.crops import CROP_CHANNELS, NUMBERS
from mpvi_bt.finding.eyes.inputs import CHANNELS

VERSION = 1  # of inputs and layers: weights of another one do not fit
CELL_PX = 4
COVERS = ("background", "furniture", "movable", "robot")  # what can cover a pixel
MULTIPLE_PX = 32  # height and width of what goes in are multiples of it
OFFSET_PX = 8.0  # that a thing's center is away, as a unit


@dataclass(frozen=True)
class Layer:
    """A convolution.

    Attributes:
        name: Of its weights.
        into, out: Channels.
        size: Of its kernel, 3 or 1 [px].
        stride: 1 or 2.
        rectified: Whether it is normalized in training and rectified.
        residual: Whether what goes in is added to what comes out.
    """

    name: str
    into: int
    out: int
    size: int = 3
    stride: int = 1
    rectified: bool = True
    residual: bool = False


# All our choice.
STEM, WIDTHS, NECK, HEAD = 24, (48, 96, 160, 224), 80, 96
CROP_WIDTHS, DENSE = (32, 64, 128), 192
_DEPTHS = (1, 2, 2, 2)


def stages() -> list[list[Layer]]:
    """The stem and the first stage together, then each further stage: a quarter, 1/8, 1/16 and 1/32 of the picture."""
    out, width = [], STEM
    for k, (wide, deep) in enumerate(zip(WIDTHS, _DEPTHS, strict=True)):
        stage = [Layer("stem", CHANNELS, STEM, stride=2)] if k == 0 else []
        stage.append(Layer(f"stage{k}.0", width, wide, stride=2))
        stage += [Layer(f"stage{k}.{j + 1}", wide, wide, residual=True) for j in range(deep)]
        out.append(stage)
        width = wide
    return out


def laterals() -> list[Layer]:
    """From each stage to the neck."""
    return [Layer(f"lateral{k}", wide, NECK, size=1, rectified=False) for k, wide in enumerate(WIDTHS)]


def smoothing() -> list[Layer]:
    """After each addition in the neck."""
    return [Layer(f"smooth{k}", NECK, NECK) for k in range(len(WIDTHS))]


def head() -> Layer:
    """Between the neck and the answers."""
    return Layer("head", NECK, HEAD)


def answers(kinds: int) -> list[Layer]:
    """Background, kinds, what is movable; what covers each pixel of a cell; nearness of a center, the way there."""
    return [
        Layer("kinds", HEAD, kinds + 2, size=1, rectified=False),
        Layer("covers", HEAD, len(COVERS) * CELL_PX**2, size=1, rectified=False),
        Layer("center", HEAD, 3, size=1, rectified=False),
    ]


def layers(kinds: int) -> list[Layer]:
    """All of them."""
    return [*(layer for stage in stages() for layer in stage), *laterals(), *smoothing(), head(), *answers(kinds)]


def crop_layers() -> list[Layer]:
    """The convolutions of the second look: 40 to 5 px."""
    first, second, third = CROP_WIDTHS
    return [
        Layer("crop.0", CROP_CHANNELS, first, stride=2),
        Layer("crop.1", first, second, stride=2),
        Layer("crop.2", second, second, residual=True),
        Layer("crop.3", second, third, stride=2),
        Layer("crop.4", third, third, residual=True),
    ]


def dense_layers(kinds: int) -> list[Layer]:
    """What follows on the means over the thing and over the crop, and on the numbers; the last answer is "nothing"."""
    return [
        Layer("dense.0", 2 * CROP_WIDTHS[-1] + NUMBERS, DENSE, size=1, rectified=False),
        Layer("dense.1", DENSE, kinds + 1, size=1, rectified=False),
    ]
