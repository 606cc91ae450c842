"""Colors of imported meshes: of vertices, faces, materials and textures, as one color a triangle.

A material has a factor (glTF's `baseColorFactor`, MTL's `Kd`, a URDF's `color`), a texture, or both: they are
multiplied. Factors are taken as they are written, without a change of color space.
"""

from __future__ import annotations

import io
import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array

if TYPE_CHECKING:
    import trimesh
    from PIL.Image import Image

_GRAY = 0.6  # of a mesh without a color: light, as most things of a house are. Our choice
_MAX_BYTES = 64 << 20  # of a file that a mesh names. Our choice: a texture of 4096 x 4096 pixels, not compressed
_NO_PICTURES = (".mtl", ".bin")  # what a mesh names besides
_OPAQUE = 0.99  # smallest opacity that is not called transparent
_SAMPLES = 4  # texture samples along each edge of a triangle: 10 in all. Our choice: a triangle gets one color anyway
# Options of a texture in an MTL file, and how many arguments they have, at least and at most
_OPTIONS = {
    "-blendu": (1, 1), "-blendv": (1, 1), "-boost": (1, 1), "-bm": (1, 1), "-cc": (1, 1), "-clamp": (1, 1),
    "-imfchan": (1, 1), "-mm": (2, 2), "-o": (1, 3), "-s": (1, 3), "-t": (1, 3), "-texres": (1, 1), "-type": (1, 1),
}  # fmt: skip
_NEUTRAL = {"-o": 0.0, "-s": 1.0, "-t": 0.0}  # arguments that leave a texture where it is
_UNREAD = {
    "KHR_texture_basisu": "textures in KTX2 are not read",
    "KHR_texture_transform": "transforms of textures are not applied",
}  # extensions of glTF that change colors


class NamedFiles:
    """Reads the files that a mesh names: materials and textures. trimesh takes it as a resolver.

    Attributes:
        remarks: What was missing or not applied, a line each.
    """

    def __init__(self, mesh: Path) -> None:
        self.file_name = mesh.name
        self.remarks: list[str] = []
        self._folder = mesh.resolve().parent

    def get(self, name: str) -> bytes:
        """The content of a file, looked for where the name says, then beside the mesh.

        Raises:
            FileNotFoundError: It is not there, is no regular file, or is too large; a remark says so.
        """
        plain = self._without_options(name).replace("\\", "/")
        for path in (self._folder / plain, self._folder / plain.rsplit("/", 1)[-1]):
            if path.is_file() and path.stat().st_size <= _MAX_BYTES:
                content = path.read_bytes()
                if path.suffix.lower() not in _NO_PICTURES:
                    _picture(content, path, self.remarks)
                return content
        _add(self.remarks, f"{self.file_name}: names {plain!r}, and no such file can be read: its colors are lost")
        raise FileNotFoundError(plain)

    __getitem__ = get

    def _without_options(self, name: str) -> str:
        """The file in a line of an MTL file, such as `-s 1 1 1 wood.png`, whose name may have spaces."""
        words = name.split()
        while words and words[0] in _OPTIONS:
            option = words.pop(0)
            least, most = _OPTIONS[option]
            given = [words.pop(0) for _ in range(min(least, len(words)))]
            while len(given) < most and len(words) > 1 and _number(words[0]) is not None:
                given.append(words.pop(0))
            if option in _NEUTRAL and any(_number(word) != _NEUTRAL[option] for word in given):
                _add(self.remarks, f"{self.file_name}: {option} {' '.join(given)} of a texture is not applied")
        return " ".join(words) if words and words != name.split() else name.strip()


def _picture(content: bytes, path: Path, remarks: list[str]) -> Image | None:
    """The picture in a file's content; None: it is none, which a remark says."""
    from PIL import Image, UnidentifiedImageError

    try:
        found = Image.open(io.BytesIO(content))
        found.load()
        return found
    except UnidentifiedImageError:
        fault = "its format is not known"
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:  # which Pillow raises
        fault = " ".join(str(error).split())
    _add(remarks, f"{path}: cannot be read as a picture ({fault}): its colors are lost")
    return None


def named_picture(name: str, path: Path | None, file: Path, remarks: list[str]) -> Image | None:
    """The texture named by a URDF; None, with a remark, if it cannot be read.

    Args:
        name: As the file names it.
        path: Where it is; None: it was not found.
        file: The URDF.
        remarks: Is added to.
    """
    if path is None or path.stat().st_size > _MAX_BYTES:
        _add(remarks, f"{file.name}: names {name!r}, and no such file can be read: its colors are lost")
        return None
    return _picture(path.read_bytes(), path, remarks)


def _number(word: str) -> float | None:
    return float(word) if re.fullmatch(r"[-+]?\d*\.?\d+", word) else None


def unread_extensions(file: Path) -> Iterator[str]:
    """A remark for each extension of a glTF file that changes its colors and is not read."""
    if file.suffix.lower() not in (".glb", ".gltf"):
        return
    content = file.read_bytes()
    if content[:4] == b"glTF":  # header of 12 bytes, then the length and kind of the JSON chunk
        content = content[20 : 20 + struct.unpack_from("<I", content, 12)[0]]
    for extension in json.loads(content).get("extensionsUsed", ()):
        if extension in _UNREAD:
            yield f"{file.name}: {_UNREAD[extension]} ({extension})"


def face_colors(mesh: trimesh.Trimesh, remarks: list[str]) -> Array:
    """(T, 3) color of each triangle, 0 to 1.

    Args:
        mesh: With colors of faces or vertices, or with a material.
        remarks: What was guessed or left out is added, once.
    """
    visual: Any = mesh.visual
    material = getattr(visual, "material", None)
    if material is None:
        if visual.kind in ("face", "vertex"):
            return np.asarray(visual.face_colors, float)[:, :3] / 255
        _add(remarks, "no color is given for some of its triangles: they are gray")
        return np.full((len(mesh.faces), 3), _GRAY)
    factor, image = _factor(material), _texture(material)
    colors = np.ones((len(mesh.faces), 3))
    corner_colors = visual.vertex_attributes.get("color")
    if factor is None and image is None and corner_colors is None:
        _add(remarks, f"material {material.name!r} has no color: what it covers is gray")
        return colors * _GRAY
    if factor is not None:
        colors *= factor[:3]
        if factor[3] < _OPAQUE:
            _add(remarks, f"material {material.name!r} is transparent: it is drawn opaque")
    if image is not None:
        colors *= _sampled(mesh, image, visual.uv, remarks)
    if corner_colors is not None:
        share = np.asarray(corner_colors, float)[:, :3]
        whole = 255.0 if np.issubdtype(corner_colors.dtype, np.integer) else 1.0
        colors *= (share / whole)[mesh.faces].mean(1)
    return np.clip(colors, 0, 1)


def _factor(material: Any) -> Array | None:
    """(4,) color and opacity of a material, 0 to 1; None: it names none."""
    given = material.baseColorFactor if hasattr(material, "baseColorFactor") else None
    kwargs = getattr(material, "kwargs", {})
    if given is None and "kd" in kwargs:  # trimesh's own default of Kd is no color of the file
        given = material.diffuse
    if given is None:
        return None
    color = np.asarray(given, float) / 255
    opacity = _number(str(kwargs["d"][-1])) if kwargs.get("d") else None
    return np.array([*color[:3], color[3] if opacity is None else opacity])


def _texture(material: Any) -> Image | None:
    """The image of a material's color; None: it has none."""
    found: Image | None = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    return found


def _sampled(mesh: trimesh.Trimesh, image: Image, uv: Any, remarks: list[str]) -> Array:
    """(T, 3) mean color of a texture over each triangle; of the whole one where the mesh has no coordinates for it."""
    try:
        pixels = np.asarray(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:  # of a broken picture inside the mesh's own file
        _add(remarks, f"a texture cannot be read ({' '.join(str(error).split())}): its colors are lost")
        return np.ones((len(mesh.faces), 3))
    if uv is None or len(uv) != len(mesh.vertices):
        _add(remarks, "a texture has no coordinates on the mesh: its mean color is taken")
        return np.broadcast_to(pixels.mean((0, 1)) / 255, (len(mesh.faces), 3))
    steps = [(i, j, _SAMPLES - 1 - i - j) for i in range(_SAMPLES) for j in range(_SAMPLES - i)]
    weights = (np.array(steps) + 1 / 3) / _SAMPLES  # (S, 3), inside the triangle
    corners = np.nan_to_num(np.asarray(uv, float)[:, :2])[mesh.faces]  # (T, 3, 2)
    at = matmul(weights, corners) % 1.0  # textures repeat
    height, width = pixels.shape[:2]
    column = np.minimum((at[..., 0] * width).astype(int), width - 1)
    row = np.minimum(((1 - at[..., 1]) * height).astype(int), height - 1)
    return pixels[row, column].mean(1) / 255


def _add(remarks: list[str], remark: str) -> None:
    if remark not in remarks:
        remarks.append(remark)
