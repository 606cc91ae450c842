"""The scene, and the light shaders that draw it.

SAPIEN's stock shaders sample a table that takes 14 CPU-seconds to compute before the first picture. Nothing here uses
what it adds (reflections of an environment map), so a copy of the installed package's own shaders is made without it.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

import sapien

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import NoRenderingDevice

PHYSICS_HZ = 120  # steps a second, four a control step; BEHAVIOR has 120, too
SOLVER_ITERATIONS = 15  # fewer lose a held bin (measured: 8 iterations, 1 delivery in 12)

_SKY = "vec3(0.80, 0.88, 0.94)"  # sRGB; what is drawn where nothing is
_FORMATS = {"Color": "r8g8b8a8unorm", "ColorRaw": "r8g8b8a8unorm", "PositionSegmentation": "r16g16b16a16sint"}
_EDITS = (
    (r"^layout\([^)]*\) uniform sampler2D samplerBRDFLUT;\n", ""),
    (r"texture\(samplerBRDFLUT, [^;]*\.xy", "vec2(0.0)"),
    (r"vec3 bg = pow\(getBackgroundColor\(.*;", f"vec3 bg = {_SKY};"),
)


def new_scene(render: bool) -> sapien.Scene:
    """An empty scene with this project's physics and, with `render`, cameras and lights.

    Physics and picture settings of SAPIEN are those of the whole process.

    Raises:
        NoRenderingDevice: Pictures are wanted and there is no usable Vulkan device.
    """
    physx = sapien.physx
    physx.set_shape_config(contact_offset=0.01, rest_offset=0.0)
    physx.set_body_config(
        solver_position_iterations=SOLVER_ITERATIONS, solver_velocity_iterations=1, sleep_threshold=0.005
    )
    physx.set_scene_config(
        gravity=[0, 0, -9.81],
        bounce_threshold=2.0,
        enable_pcm=True,
        enable_tgs=True,
        enable_ccd=False,
        enable_friction_every_iteration=True,
        cpu_workers=0,
    )
    physx.set_default_material(0.3, 0.3, 0.0)
    systems: list[sapien.System] = [physx.PhysxCpuSystem()]
    if render:
        systems.append(renderer())
    scene = sapien.Scene(systems)
    scene.set_timestep(1 / PHYSICS_HZ)
    if render:
        add_lights(scene)
    return scene


def add_lights(scene: sapien.Scene) -> None:
    """Light a scene as all of this project's are."""
    scene.set_ambient_light([0.52, 0.52, 0.54])
    scene.add_directional_light([0.35, 0.6, -1.0], [1.15, 1.1, 1.0], shadow=False)
    scene.add_directional_light([-0.7, -0.3, -0.45], [0.38, 0.4, 0.45], shadow=False)


def use_light_shaders() -> None:
    """Have cameras that are made from now on draw with the light shaders; a setting of the whole process."""
    sapien.render.set_camera_shader_dir(str(shader_folder()))
    for picture, pixel in _FORMATS.items():
        sapien.render.set_picture_format(picture, pixel)


def renderer() -> sapien.render.RenderSystem:
    """A renderer on the device that SAPIEN chooses. Raises NoRenderingDevice if there is none."""
    try:
        sapien.render.set_log_level("error")
        use_light_shaders()
        return sapien.render.RenderSystem()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise NoRenderingDevice(
            f"this machine can draw no pictures ({reason}); `mpvi doctor` says what is missing and how to mend it, "
            "and --detector oracle --checker oracle need no pictures"
        ) from None


@cache
def shader_folder() -> Path:
    """The light shaders, made where they are not yet; the stock ones if SAPIEN's no longer look as they did."""
    stock = Path(sapien.__file__).parent / "vulkan_shader"
    texts = {path.name: path.read_text() for path in (stock / "minimal").iterdir() if path.is_file()}
    light = {name: _lightened(text) for name, text in texts.items()}
    if any("samplerBRDFLUT" in text for text in light.values()):
        return stock / "minimal"
    key = hashlib.sha256(repr(sorted(light.items())).encode()).hexdigest()[:12]
    for home in paths.caches():
        target = home / f"shaders-{sapien.__version__}-{key}"
        try:
            _write(target, light, stock / "common")
        except OSError:
            continue
        return target / "light"
    return stock / "minimal"


def _lightened(text: str) -> str:
    for pattern, replacement in _EDITS:
        text = re.sub(pattern, replacement, text, flags=re.MULTILINE)
    return text


def _write(target: Path, texts: dict[str, str], common: Path) -> None:
    """Put shader texts into `target`/light with their common includes beside them, all or nothing.

    Raises:
        OSError: They cannot be written there, or other texts stand there.
    """
    if _holds(target / "light", texts):
        return
    target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if target.parent.stat().st_uid != os.getuid():
        raise PermissionError(f"{target.parent} belongs to someone else")
    with tempfile.TemporaryDirectory(prefix="shaders-", dir=target.parent) as made:
        fresh = Path(made) / "fresh"
        shutil.copytree(common, fresh / "common")
        (fresh / "light").mkdir()
        for name, text in texts.items():
            (fresh / "light" / name).write_text(text)
        try:
            fresh.rename(target)
        except OSError:
            if not _holds(target / "light", texts):  # else another process was faster
                raise


def _holds(folder: Path, texts: dict[str, str]) -> bool:
    files = ((folder / name, text) for name, text in texts.items())
    return all(path.is_file() and path.read_text() == text for path, text in files)
