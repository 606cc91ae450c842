"""ManiSkill's views of scenes from our builder: things, camera shaders, physics."""

from __future__ import annotations

from collections.abc import Sequence

import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.render import PREBUILT_SHADER_CONFIGS, ShaderConfig
from mani_skill.utils.structs import Actor, Articulation, Pose
from mani_skill.utils.structs.types import GPUMemoryConfig, SceneConfig, SimConfig

from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.sim.shaders import PHYSICS_HZ, SOLVER_ITERATIONS, shader_folder

SHADERS = "mpvi_light"  # of a CameraConfig's shader_pack: our light shaders, with the pictures of ManiSkill's "minimal"
_CONTACTS = 4096  # that a house on the GPU is given room for
_APART_M = 40.0  # between houses of parallel environments; one is 20 m wide with its garden


def simulation(houses: int = 1) -> SimConfig:
    """The physics of `sim.shaders.new_scene`, as ManiSkill is told of it; on a GPU, with room for so many houses."""
    memory = GPUMemoryConfig()
    memory.max_rigid_contact_count = max(memory.max_rigid_contact_count, _CONTACTS * houses)
    memory.max_rigid_patch_count = max(memory.max_rigid_patch_count, _CONTACTS * houses)
    return SimConfig(
        spacing=_APART_M,
        gpu_memory_config=memory,
        sim_freq=PHYSICS_HZ,
        control_freq=CONTROL_HZ,
        scene_config=SceneConfig(contact_offset=0.01, solver_position_iterations=SOLVER_ITERATIONS),
    )


def register_shaders() -> None:
    """Let cameras name `SHADERS` as their shader pack."""
    if SHADERS not in PREBUILT_SHADER_CONFIGS:
        pictures = PREBUILT_SHADER_CONFIGS["minimal"]
        PREBUILT_SHADER_CONFIGS[SHADERS] = ShaderConfig(
            shader_pack=str(shader_folder()),
            texture_names=pictures.texture_names,
            texture_transforms=pictures.texture_transforms,
        )


def adopt(scene: ManiSkillScene, things: Sequence[Thing]) -> Actor | Articulation:
    """Have ManiSkill know a thing: its state is part of the environment's, its pixels of the segmentation map.

    Args:
        scene: The scene.
        things: The same thing in each of its sub scenes.
    """
    name = things[0].name
    poses = [thing.entity.pose for thing in things]
    if things[0].articulation is not None:
        return adopt_articulation(scene, name, [t.articulation for t in things if t.articulation], poses)
    actor = Actor.create_from_entities([t.entity for t in things], scene, torch.arange(len(things)), shared_name=name)
    actor.initial_pose = _batched(scene, poses)
    scene.actors[name] = actor
    if actor.px_body_type != "static":
        scene.add_to_state_dict_registry(actor)
    return actor


def adopt_articulation(
    scene: ManiSkillScene,
    name: str,
    articulations: Sequence[sapien.physx.PhysxArticulation],
    poses: Sequence[sapien.Pose],
) -> Articulation:
    """Have ManiSkill know an articulation under a name, one of it in each sub scene; its links keep their names."""
    for k, articulation in enumerate(articulations):
        # ManiSkill takes names of this form apart again.
        articulation.name = f"scene-{k}_{name}"
        for part in (*articulation.links, *articulation.joints):
            part.name = f"scene-{k}-{name}_{part.name}"
    view = Articulation.create_from_physx_articulations(list(articulations), scene, torch.arange(len(articulations)))
    view.initial_pose = _batched(scene, poses)
    scene.articulations[name] = view
    scene.add_to_state_dict_registry(view)
    return view


def _batched(scene: ManiSkillScene, poses: Sequence[sapien.Pose]) -> Pose:
    return Pose.create(torch.tensor([[*pose.p, *pose.q] for pose in poses], dtype=torch.float32, device=scene.device))
