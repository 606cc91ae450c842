"""The networks of a learned policy, run in numpy, and the file of their weights.

Both are a PointNet for each of two sets of points, whose answers go with all else through fully connected layers
with layer normalization and GELU. Our choice: small enough for one core, and for a wheel.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import erf

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.learned.features import FELT_SIZE, HYPOTHESIS_SIZE, SCALE, WAYPOINT_SIZE, WAYPOINTS

VERSION = 1  # of features and networks: weights of another one do not fit
POINT_WIDTHS = (64, 128)
ACTOR_WIDTHS = (384, 384, 384)
PROPOSER_WIDTHS = (256, 256)
HYPOTHESES = 16
ACTOR_POINT, PROPOSER_POINT, PROPOSER_TOLD = 9, 4, 4  # numbers of a point and of all else
_EPSILON = 1e-5  # of layer normalization
_MOST = 6.0  # standard deviations that an input counts for


@dataclass(frozen=True)
class NetworkSizes:
    """Sizes of a network.

    Attributes:
        point: Numbers of a point.
        told: Numbers of all else.
        widths: Of the layers after the points.
        out: Numbers of the answer.
    """

    point: int
    told: int
    widths: tuple[int, ...]
    out: int

    def layers(self) -> dict[str, tuple[int, ...]]:
        """Name and shape of every weight: a row for each number that goes in, a column for each that comes out."""
        out: dict[str, tuple[int, ...]] = {}
        for points in ("target", "context"):
            for k, (n, m) in enumerate(zip((self.point, *POINT_WIDTHS), POINT_WIDTHS, strict=False)):
                out |= {f"{points}.{2 * k}.weight": (n, m), f"{points}.{2 * k}.bias": (m,)}
        sizes = (2 * POINT_WIDTHS[-1] + self.told, *self.widths, self.out)
        for k, (n, m) in enumerate(itertools.pairwise(sizes)):
            out |= {f"trunk.{4 * k}.weight": (n, m), f"trunk.{4 * k}.bias": (m,)}
            if k < len(self.widths):
                out |= {f"trunk.{4 * k + 1}.weight": (m,), f"trunk.{4 * k + 1}.bias": (m,)}
        return out


ACTOR = NetworkSizes(ACTOR_POINT, FELT_SIZE, ACTOR_WIDTHS, WAYPOINTS * WAYPOINT_SIZE + 1)
PROPOSER = NetworkSizes(PROPOSER_POINT, PROPOSER_TOLD, PROPOSER_WIDTHS, HYPOTHESES * (HYPOTHESIS_SIZE + 1))
# Means and standard deviations: of what the actor is told, of hypotheses.
_SHAPES = {
    **{f"actor.{name}": shape for name, shape in ACTOR.layers().items()},
    **{f"proposer.{name}": shape for name, shape in PROPOSER.layers().items()},
    **dict.fromkeys(("actor.mean", "actor.std"), (FELT_SIZE,)),
    **dict.fromkeys(("proposer.mean", "proposer.std"), (HYPOTHESIS_SIZE,)),
}


@dataclass(frozen=True, eq=False)
class Networks:
    """The two networks of one skill.

    Attributes:
        weights: By name, float64.
    """

    weights: Mapping[str, Array]

    def act(self, points: Array, told: Array, targets: int) -> tuple[Array, float]:
        """(8, 21) waypoints, relative to now [m, rad], and the progress, 0 to 1.

        Args:
            points: (1, m, 9) as `actor_inputs` makes them.
            told: (1, 76) likewise.
            targets: How many of the points are of the target.
        """
        w = self.weights
        told = np.clip((told - w["actor.mean"]) / w["actor.std"], -_MOST, _MOST)
        out = self._answer("actor", ACTOR, points, told, targets)
        return out[:-1].reshape(WAYPOINTS, WAYPOINT_SIZE) * SCALE, float(1 / (1 + np.exp(-out[-1])))

    def propose(self, points: Array, told: Array, targets: int) -> tuple[Array, Array]:
        """(16, 23) hypotheses and (16,) the logarithms of how likely each is.

        Args:
            points: (1, m, 4) as `Approach.points` makes them.
            told: (1, 4) likewise.
            targets: How many of the points are of the target.
        """
        out = self._answer("proposer", PROPOSER, points, told, targets).reshape(HYPOTHESES, HYPOTHESIS_SIZE + 1)
        likely = out[:, -1] - out[:, -1].max()
        w = self.weights
        return out[:, :-1] * w["proposer.std"] + w["proposer.mean"], likely - np.log(np.exp(likely).sum())

    def _answer(self, network: str, shape: NetworkSizes, points: Array, told: Array, targets: int) -> Array:
        sets = (("target", points[0, :targets]), ("context", points[0, targets:]))
        x = np.concatenate([*(self._set(f"{network}.{name}", p) for name, p in sets), told[0]])
        for k in range(len(shape.widths)):
            x = self._linear(f"{network}.trunk.{4 * k}", x)
            x = (x - x.mean()) / np.sqrt(x.var() + _EPSILON)
            at = f"{network}.trunk.{4 * k + 1}"
            x = x * self.weights[f"{at}.weight"] + self.weights[f"{at}.bias"]
            x = x * 0.5 * (1 + erf(x / np.sqrt(2)))
        return self._linear(f"{network}.trunk.{4 * len(shape.widths)}", x)

    def _set(self, name: str, points: Array) -> Array:
        x = np.maximum(self._linear(f"{name}.0", points), 0)
        return self._linear(f"{name}.2", x).max(0)

    def _linear(self, name: str, x: Array) -> Array:
        return matmul(x, self.weights[f"{name}.weight"]) + self.weights[f"{name}.bias"]


@dataclass(frozen=True, eq=False)
class Weights:
    """What a file of weights holds.

    Attributes:
        robot: Whose they are.
        skills: Networks by skill.
        about: How they were made.
    """

    robot: str
    skills: Mapping[str, Networks]
    about: Mapping[str, Any]

    def save(self, path: Path) -> None:
        """Write them, in half precision but for means and standard deviations."""
        arrays = {}
        for skill, networks in self.skills.items():
            for name, array in networks.weights.items():
                exact = name.rpartition(".")[2] in ("mean", "std")
                arrays[f"{skill}/{name}"] = array.astype(np.float32 if exact else np.float16)
        head = {"version": VERSION, "robot": self.robot, "skills": list(self.skills), "about": dict(self.about)}
        np.savez_compressed(path, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> Weights:
        """Read a file of weights.

        Raises:
            UserError: There is none, it is cut off or no such file, or its weights are of another version.
        """
        try:
            with np.load(path, allow_pickle=False) as kept:
                head = json.loads(str(kept["head"]))
                version = head["version"]
                if version != VERSION:
                    raise UserError(f"{path}: weights of version {version!r:.20}; this mpvi_bt runs version {VERSION}.")
                skills = {str(skill): Networks(_read(kept, str(skill), path)) for skill in head["skills"]}
                return cls(str(head["robot"]), skills, dict(head["about"]))
        except FileNotFoundError:
            raise UserError(f"{path}: there is no such file of weights.") from None
        except UserError:
            raise
        except Exception as error:  # whatever zipfile, zlib, numpy and JSON make of broken bytes
            raise UserError(f"{path}: no whole file of weights ({' '.join(str(error).split())[:120]}).") from error


def _read(kept: Mapping[str, Array], skill: str, path: Path) -> dict[str, Array]:
    weights = {}
    for name, shape in _SHAPES.items():
        array = np.ascontiguousarray(kept[f"{skill}/{name}"], float)  # rows, which products go along
        if array.shape != shape or not np.isfinite(array).all():
            raise UserError(f"{path}: {skill}/{name} is {array.shape}, not {shape} finite numbers.")
        weights[name] = array
    return weights
