"""Files of labeled pictures: what a network learns to see from."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array

_DEPTH_M = 0.00025  # a step of depth on file; 16.4 m is the farthest
_UNREADABLE = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    zipfile.BadZipFile,
    zlib.error,
    AttributeError,
    NotImplementedError,  # of zipfile: a compression that nobody knows
)
_TOLD = {"count": "iu", "kinds": "U", "drawn": "U", "K": "f", "T_world_camera": "f", "camera": "U"}  # kinds of arrays


@dataclass(frozen=True, eq=False)
class LabeledPicture:
    """One picture, as the renderer labels it.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32 [m] along the optical axis, 0 = nothing seen; without noise.
        labels: (H, W) uint8, 0 for background, else k for thing k, counted from 1.
        kinds: Of the things, as `kind_of` names them.
        drawn: How each thing was drawn, such as "catalogue" or "held_out_shape".
        K: (3, 3) intrinsics [px].
        T_world_camera: (4, 4) camera to world, optical frame.
        camera: Its name: "head", or the side of a wrist.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    kinds: tuple[str, ...]
    drawn: tuple[str, ...]
    K: Array
    T_world_camera: Array
    camera: str


def write_pictures(path: Path, pictures: Sequence[LabeledPicture]) -> None:
    """Write pictures into one file, whole or not at all."""
    arrays = {
        "count": np.array([len(p.kinds) for p in pictures]),
        "kinds": np.array([kind for p in pictures for kind in p.kinds], np.str_),
        "drawn": np.array([drawn for p in pictures for drawn in p.drawn], np.str_),
        "K": np.array([p.K for p in pictures]),
        "T_world_camera": np.array([p.T_world_camera for p in pictures]),
        "camera": np.array([p.camera for p in pictures], np.str_),
    }
    for k, picture in enumerate(pictures):
        depth = np.rint(np.clip(picture.depth / _DEPTH_M, 0, 65535)).astype(np.uint16)
        planes = [*np.moveaxis(picture.rgb, -1, 0), depth >> 8, depth & 255, picture.labels]
        arrays[f"picture_{k}"] = np.stack([plane.astype(np.uint8) for plane in planes])
    kept = io.BytesIO()
    with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:  # higher ones take ten times longer
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w") as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)
    part = path.with_suffix(".part")
    part.write_bytes(kept.getvalue())
    part.replace(path)


class PictureFile:
    """The pictures of a file, each read when it is asked for.

    Args:
        path: Of the file.

    Raises:
        UserError: It cannot be read, or holds no pictures.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = np.load(path, allow_pickle=False)
            told = {name: self._file[name] for name in _TOLD}
        except _UNREADABLE as error:
            raise UserError(f"{path}: is no file of pictures ({' '.join(str(error).split())[:100]})") from None
        if wrong := _misfit(told):
            raise UserError(f"{path}: is no file of pictures ({wrong})")
        self._K, self._T, self._camera = told["K"], told["T_world_camera"], told["camera"]
        self._last = np.cumsum(told["count"]).tolist()
        self._kinds, self._drawn = told["kinds"].tolist(), told["drawn"].tolist()

    @property
    def kinds(self) -> frozenset[str]:
        """Of all things in them."""
        return frozenset(self._kinds)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._last)

    def __iter__(self) -> Iterator[LabeledPicture]:
        """All, in their order."""
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> LabeledPicture:
        """Picture `k`, counted from 0.

        Raises:
            UserError: It is damaged.
        """
        try:
            planes = self._file[f"picture_{k}"]
        except _UNREADABLE as error:
            raise UserError(f"{self._path}: picture {k} is damaged ({' '.join(str(error).split())[:100]})") from None
        if (
            not isinstance(planes, np.ndarray)
            or planes.dtype != np.uint8
            or planes.shape[:1] != (6,)
            or planes.ndim != 3
        ):
            raise UserError(f"{self._path}: picture {k} is damaged (it has no six planes of bytes)")
        things = slice(self._last[k - 1] if k else 0, self._last[k])
        depth = planes[3].astype(np.float32) * np.float32(256 * _DEPTH_M) + planes[4] * np.float32(_DEPTH_M)
        return LabeledPicture(
            rgb=np.ascontiguousarray(np.moveaxis(planes[:3], 0, -1)),
            depth=depth,
            labels=planes[5],
            kinds=tuple(self._kinds[things]),
            drawn=tuple(self._drawn[things]),
            K=self._K[k],
            T_world_camera=self._T[k],
            camera=str(self._camera[k]),
        )


def _misfit(told: Mapping[str, Any]) -> str:
    """What is wrong with the arrays that tell of the pictures; "" if they fit one another."""
    for name, kind in _TOLD.items():
        array = told[name]
        if not isinstance(array, np.ndarray) or array.dtype.kind not in kind or (array.ndim != 1 and kind != "f"):
            return f"its array {name!r} is of another kind"
    n, things = len(told["count"]), len(told["kinds"])
    sizes = {"K": (n, 3, 3), "T_world_camera": (n, 4, 4), "camera": (n,), "drawn": (things,)}
    for name, size in sizes.items():
        if told[name].shape != size:
            return f"its array {name!r} is {told[name].shape}, not {size}"
    if (told["count"] < 0).any() or told["count"].sum() != things:
        return f"its pictures are to have {told['count'].sum()} things, and {things} are told of"
    bad = [name for name, kind in _TOLD.items() if kind == "f" and not np.isfinite(told[name]).all()]
    return f"its array {bad[0]!r} has numbers that are not finite" if bad else ""


class _Pictures(Sequence[LabeledPicture]):
    """Those of several files."""

    def __init__(self, files: Sequence[PictureFile]) -> None:
        self._index = [(file, k) for file in files for k in range(len(file))]

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return [file[one] for file, one in self._index[k]]
        file, one = self._index[k]
        return file[one]


def pictures_in(folder: Path) -> Sequence[LabeledPicture]:
    """All pictures of all files of a folder, in the order of their names, each read when it is asked for.

    Raises:
        UserError: There are none, or a file cannot be read.
    """
    pictures = _Pictures([PictureFile(path) for path in sorted(folder.glob("*.npz"))])
    if not pictures:
        raise UserError(f"{folder}: there are no pictures; python -m benchmarks.eyes.pictures FOLDER makes some.")
    return pictures
