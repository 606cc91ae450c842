"""Cameras: pictures with depth and labels, rendered only when asked for."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np
import sapien

from mpvi_bt.ground.errors import BackendError, NoRenderingDevice
from mpvi_bt.ground.geometry.kinematics import LINK_TO_OPTICAL, transform
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.camera import Camera
from mpvi_bt.ground.robot.protocol import CameraImage

_OPTICAL_TO_LINK = transform(LINK_TO_OPTICAL.T, (0.0, 0.0, 0.0))


class Cameras:
    """Every camera of one scene.

    Attributes:
        names: Scene id to the name of the thing, for the label image; filled by the world.
        labels: Whether pictures have labels. Without, they show what a real camera does.
        before: Called before each picture, to bring what is only seen to where it belongs; set by the world.
        taken: Pictures rendered so far.
        seconds: Wall time spent on them.
    """

    def __init__(self, scene: sapien.Scene) -> None:
        self._scene = scene
        self._cameras: dict[str, sapien.render.RenderCameraComponent] = {}
        self._mounts: dict[str, Array] = {}  # (4, 4) in their entities, looking along x
        self._free: dict[tuple[int, int], sapien.Entity] = {}
        self.names: Mapping[int, str] = {}
        self.labels = True
        self.before: Callable[[], None] = lambda: None
        self.taken = 0
        self.seconds = 0.0

    @staticmethod
    def missing() -> NoRenderingDevice:
        """The error for a picture that nobody can draw."""
        return NoRenderingDevice("this world was built without rendering; `mpvi doctor` says what pictures need")

    def mount(self, name: str, camera: Camera, entity: sapien.Entity, T_entity_camera: Array | None = None) -> None:
        """Fix a camera to an entity: looking along its x with z up, or in an optical frame (4, 4)."""
        component = sapien.render.RenderCameraComponent(camera.width, camera.height)
        component.set_fovy(camera.fov_rad)
        component.near, component.far = camera.near_m, camera.far_m
        if camera.intrinsics is not None:
            component.set_perspective_parameters(camera.near_m, camera.far_m, *camera.intrinsics, 0.0)
        component.name = name
        if T_entity_camera is not None:
            self._mounts[name] = matmul(T_entity_camera, _OPTICAL_TO_LINK)
            component.set_local_pose(sapien.Pose(self._mounts[name]))
        entity.add_component(component)
        self._cameras[name] = component

    def misalign(self, camera: str, T_nominal_real: Array) -> None:
        """Have a camera sit off its nominal pose; (4, 4), its real optical frame to its nominal one."""
        T = matmul(transform(LINK_TO_OPTICAL, (0.0, 0.0, 0.0)), T_nominal_real, _OPTICAL_TO_LINK)
        if (mount := self._mounts.get(camera)) is not None:
            T = matmul(mount, T)
        self._cameras[camera].set_local_pose(sapien.Pose(T))

    def look(self, name: str) -> CameraImage:
        """Render the named camera as the world stands. Raises BackendError if there is none of that name."""
        started = time.perf_counter()
        camera = self._cameras.get(name)
        if camera is None:
            raise BackendError(f"no camera {name!r}; known: {', '.join(self._cameras)}")
        self.before()
        self._scene.update_render()
        camera.take_picture()
        # opengl camera frame [mm], and the scene id of what each pixel shows
        position = camera.get_picture("PositionSegmentation")
        depth = np.maximum(-position[..., 2], 0).astype(np.float32) / 1000
        T_world_link = camera.get_global_pose().to_transformation_matrix()
        image = CameraImage(
            camera=name,
            rgb=_bytes(camera.get_picture("Color")[..., :3]),
            depth=depth,
            labels=position[..., 3].astype(np.int32) if self.labels else None,
            names=self.names if self.labels else {},
            K=np.asarray(camera.get_intrinsic_matrix(), float),
            T_world_camera=matmul(T_world_link.astype(float), transform(LINK_TO_OPTICAL, (0.0, 0.0, 0.0))),
        )
        self.taken += 1
        self.seconds += time.perf_counter() - started
        return image

    def look_from(self, T_world_camera: Array, size: tuple[int, int] = (640, 480), fov_rad: float = 1.0) -> CameraImage:
        """Render from anywhere.

        Args:
            T_world_camera: (4, 4) optical frame (x right, y down, z forward) to world.
            size: Width and height [px].
            fov_rad: Vertical field of view.
        """
        name = f"outside-{size[0]}x{size[1]}"
        if name not in self._cameras:
            entity = sapien.Entity()
            entity.name = name
            self._scene.add_entity(entity)
            self.mount(name, Camera(*size, fov_rad, 0.05, 60.0, ""), entity)
        self._cameras[name].set_fovy(fov_rad)
        self._cameras[name].entity.set_pose(sapien.Pose(matmul(T_world_camera, _OPTICAL_TO_LINK)))
        return self.look(name)


def _bytes(color: Array) -> np.ndarray:
    if color.dtype == np.uint8:
        return np.ascontiguousarray(color)
    return (np.clip(color, 0, 1) * 255).astype(np.uint8)
