"""Builds houses and objects in a SAPIEN scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sapien

from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.house.things.description import Color, Description, Part, PartsOfBody, RigidBody, Skin
from mpvi_bt.house.things.meshes import faceted, meshes

_FIXED_BIT = 16  # of collision group 2: what never moves need not be tested against what never moves
_HANDLE_FRICTION = 1.2
_SAPIEN_CYLINDER = np.array([[0.0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]])  # its axis is x, ours is z
_ROUGHNESS = 0.85


@dataclass(eq=False)
class Thing:
    """Something in the scene.

    Attributes:
        name: Unique in the scene: a BDDL name, the house's name of a fixture, "floor_<room>" or "wall_<room>".
        synset: Such as "ashcan.n.01".
        description: Its solids and volumes, in its bodies' frames.
        entities: The SAPIEN entity of each body, by the body's name.
        articulation: What holds the joints, or None if nothing moves.
        movable: Whether it is a free body.
    """

    name: str
    synset: str
    description: Description
    entities: Mapping[str, sapien.Entity]
    articulation: sapien.physx.PhysxArticulation | None = None
    movable: bool = False
    _joints: Mapping[str, int] = field(default_factory=dict, repr=False)
    _stood: list[tuple[float, ...]] | None = field(default=None, init=False, repr=False)
    _there: tuple[list[Solid], list[Solid]] = field(default=([], []), init=False, repr=False)

    @property
    def entity(self) -> sapien.Entity:
        """The entity of its root body."""
        return self.entities[self.description.root.name]

    @cached_property
    def rigid_body(self) -> sapien.physx.PhysxRigidDynamicComponent:
        """The dynamics of a movable thing that is one body."""
        return self.entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)

    @cached_property
    def root_body(self) -> sapien.physx.PhysxRigidBodyComponent:
        """The body of a movable thing to fix to a hand: its only body, or the root of its joints."""
        return self.rigid_body if self.articulation is None else self.articulation.root

    @property
    def moves(self) -> bool:
        """Whether it, or any part of it, can move."""
        return self.movable or self.articulation is not None

    @property
    def sleeps(self) -> bool:
        """Whether physics passes a movable thing over, because it rests."""
        return bool(self.root_body.is_sleeping)

    @property
    def origin(self) -> Array:
        """(3,) of its root body's frame, in the world [m]; as physics has it, in single precision."""
        return np.asarray(self.entity.pose.p)

    def wake(self) -> None:
        """Have physics go on with it, and tell its contacts, if it sleeps."""
        self.root_body.wake_up()

    def T_world_body(self, body: str | None = None) -> Array:  # noqa: N802
        """(4, 4) pose of a body, the root by default."""
        entity = self.entity if body is None else self.entities[body]
        return np.asarray(entity.pose.to_transformation_matrix(), float)

    def place(self, T: Array) -> None:
        """Put a movable thing at `T` (4, 4, body to world), at rest; its joints stay as they are."""
        if self.articulation is not None:
            q = self.articulation.get_qpos()
            self._set_root(sapien.Pose(T), np.zeros(6))
            self.articulation.set_qpos(q)
            self.articulation.set_qvel(np.zeros_like(q))
            self.wake()
            return
        self.entity.set_pose(sapien.Pose(T))
        if not self.rigid_body.kinematic:
            self.rigid_body.set_linear_velocity([0, 0, 0])
            self.rigid_body.set_angular_velocity([0, 0, 0])
            self.wake()

    def motion(self) -> dict[str, list[float]]:
        """How a thing that can move stands and moves: a free body's pose (xyz, wxyz) and velocities, joints' q and v.

        A free body with joints has both, its velocities as "root_v".
        """
        out: dict[str, list[float]] = {}
        if self.movable:
            pose, body = self.entity.pose, self.root_body
            out["pose"] = [*pose.p.tolist(), *pose.q.tolist()]
            speeds = [*body.linear_velocity.tolist(), *body.angular_velocity.tolist()]
            out["v" if self.articulation is None else "root_v"] = speeds
        if self.articulation is not None:
            out |= {"q": self.articulation.get_qpos().tolist(), "v": self.articulation.get_qvel().tolist()}
        return out

    def set_motion(self, motion: Mapping[str, list[float]]) -> None:
        """Have it stand and move as `motion` told. Raises KeyError or ValueError if that is of another thing."""
        if self.articulation is not None:
            if self.movable:
                pose = _finite(motion["pose"], 7)
                self._set_root(sapien.Pose(pose[:3], pose[3:]), _finite(motion["root_v"], 6))
            self.articulation.set_qpos(_finite(motion["q"], len(self.articulation.get_qpos())))
            self.articulation.set_qvel(_finite(motion["v"], len(self.articulation.get_qpos())))
        else:
            pose, v = _finite(motion["pose"], 7), _finite(motion["v"], 6)
            self.entity.set_pose(sapien.Pose(pose[:3], pose[3:]))
            self.rigid_body.set_linear_velocity(v[:3])
            self.rigid_body.set_angular_velocity(v[3:])
        if self.movable:
            self.wake()

    def _set_root(self, pose: sapien.Pose, v: Array) -> None:
        assert self.articulation is not None
        self.articulation.set_root_pose(pose)
        self.articulation.set_root_linear_velocity(v[:3])
        self.articulation.set_root_angular_velocity(v[3:])

    def solids(self) -> list[Solid]:
        """Solids for collision, posed in the world as they stand now."""
        return list(self._posed()[0])

    def volumes(self) -> list[Solid]:
        """Container volumes, posed in the world as they stand now."""
        return list(self._posed()[1])

    def joint_fractions(self) -> list[float]:
        """Position of each joint, 0 closed to 1 fully open, in the order of the description's bodies."""
        if self.articulation is None:
            return []
        q = self.articulation.get_qpos()
        return [float(q[at]) / limit for at, limit in self.openings]

    @property
    def openings(self) -> list[tuple[int, float]]:
        """Where each joint is among the articulation's, and its limit [m, rad], in the order of the description."""
        return [(self._joints[b.name], b.joint.limit) for b in self.description.bodies if b.joint is not None]

    def set_joint_fraction(self, body: str, fraction: float) -> None:
        """Put a door or drawer at a position, 0 closed to 1 fully open, at rest."""
        assert self.articulation is not None
        joint = next(b.joint for b in self.description.bodies if b.name == body)
        assert joint is not None
        q = self.articulation.get_qpos()
        q[self._joints[body]] = fraction * joint.limit
        self.articulation.set_qpos(q)
        self.articulation.set_qvel(np.zeros_like(q))

    def _posed(self) -> tuple[list[Solid], list[Solid]]:
        """Solids and volumes: worked out anew only where a body has moved since the last time."""
        stands = [(*pose.p.tolist(), *pose.q.tolist()) for pose in (e.pose for e in self.entities.values())]
        if stands != self._stood:
            frames = {body.name: self.T_world_body(body.name) for body in self.description.bodies}
            self._stood = stands
            self._there = (
                [p.solid.moved(frames[b.name]) for b in self.description.bodies for p in b.parts if p.collides],
                [volume.moved(frames[b.name]) for b in self.description.bodies for volume in b.volumes],
            )
        return self._there


def _finite(values: list[float], count: int) -> Array:
    array = np.array(values, float)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise ValueError(f"{count} finite numbers are due, not {array.shape}")
    return array


def build_house(scene: sapien.Scene, house: House, render: bool) -> dict[str, Thing]:
    """Build floors, walls and fixtures.

    Args:
        render: Whether to build what cameras see too; without it no rendering system is needed.

    Returns:
        Things by name: every fixture, "floor_<room>" and "wall_<room>" for each room, "wall_outside".
    """
    builder = _Builder(scene, render)
    things = {}
    for room in house.rooms.values():
        name = f"floor_{room.name}"
        floor = Description((RigidBody("body", (Part(room.floor, room.floor_color),)),))
        things[name] = builder.static(name, "floor.n.01", floor, np.eye(4), 0.5)
    for room_name in dict.fromkeys(wall.room for wall in house.walls):
        name = f"wall_{room_name}"
        parts = PartsOfBody([Part(wall.solid, wall.color) for wall in house.walls if wall.room == room_name])
        outdoors = room_name in house.rooms and house.rooms[room_name].outdoors
        things[name] = builder.static(name, "hedge.n.01" if outdoors else "wall.n.01", parts.thing(), np.eye(4), 0.5)
    for fixture in house.fixtures.values():
        entry = fixture.entry
        if entry.mass_kg is not None:  # such as a chair that rolls
            things[fixture.name] = builder.movable(entry, fixture.name, fixture.T_world_fixture)
            continue
        build = builder.jointed if entry.description.jointed else builder.static
        things[fixture.name] = build(
            fixture.name, entry.synset, entry.description, fixture.T_world_fixture, entry.friction
        )
    return things


def build_object(scene: sapien.Scene, entry: CatalogueEntry, name: str, T: Array, render: bool) -> Thing:
    """Build a movable object with its body frame at `T` (4, 4, body to world).

    Raises:
        ValueError: The entry has no mass: it is a fixture.
    """
    return _Builder(scene, render).movable(entry, name, T)


class _Builder:
    """Adds things to one scene, sharing materials."""

    def __init__(self, scene: sapien.Scene, render: bool) -> None:
        self.scene = scene
        self.render = render
        self.surfaces: dict[float, sapien.physx.PhysxMaterial] = {}
        self.paints: dict[Color, sapien.render.RenderMaterial] = {}

    def static(self, name: str, synset: str, description: Description, T: Array, friction: float) -> Thing:
        builder = self.scene.create_actor_builder()
        self._add(builder, description.root, friction)
        builder.set_initial_pose(sapien.Pose(T))
        entity = builder.build_static(name)
        body = entity.find_component_by_type(sapien.physx.PhysxRigidStaticComponent)
        self._add_hulls(body, description.root, friction)
        _mark_fixed(body)
        self._show(entity, description.root)
        return Thing(name, synset, description, {description.root.name: entity})

    def movable(self, entry: CatalogueEntry, name: str, T: Array) -> Thing:
        if entry.mass_kg is None:
            raise ValueError(f"{entry.name} has no mass in the catalogue: it is a fixture")
        description = entry.description
        if description.jointed:
            thing = self.jointed(name, entry.synset, description, T, entry.friction, fixed=False)
            assert thing.articulation is not None
            scale = entry.mass_kg / sum(link.mass for link in thing.articulation.links)
            for link in thing.articulation.links:
                _weigh(link, link.mass * scale, entry.rolling_damping)
            return thing
        builder = self.scene.create_actor_builder()
        self._add(builder, description.root, entry.friction)
        builder.set_initial_pose(sapien.Pose(T))
        entity = builder.build(name)
        body = entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
        self._add_hulls(body, description.root, entry.friction)
        _weigh(body, entry.mass_kg, entry.rolling_damping)
        self._show(entity, description.root)
        return Thing(name, entry.synset, description, {description.root.name: entity}, movable=True)

    def jointed(
        self, name: str, synset: str, description: Description, T: Array, friction: float, fixed: bool = True
    ) -> Thing:
        builder = self.scene.create_articulation_builder()
        root = builder.create_link_builder()
        for body in description.bodies:
            link = root if body.joint is None else builder.create_link_builder(root)
            link.set_name(f"{name}/{body.name}")
            self._add(link, body, friction, density=250.0)
            if body.joint is not None:
                joint = body.joint
                link.set_joint_name(f"{name}/{body.name}")
                link.set_joint_properties(
                    "revolute" if joint.kind == "hinge" else "prismatic",
                    [[0.0, joint.limit]],
                    pose_in_parent=sapien.Pose(_frame_along(joint.axis, joint.origin)),
                    pose_in_child=sapien.Pose(_frame_along(joint.axis, np.zeros(3))),
                    friction=joint.friction,
                    damping=joint.damping,
                )
        builder.set_initial_pose(sapien.Pose(T))
        articulation = builder.build(fix_root_link=fixed)
        articulation.set_name(name)
        if not isinstance(self.scene.physx_system, sapien.physx.PhysxGpuSystem):
            articulation.set_qpos(np.zeros(articulation.dof))  # else its links have no poses before the first step
        links = {link.name.removeprefix(f"{name}/"): link for link in articulation.links}
        for body in description.bodies:
            self._add_hulls(links[body.name], body, friction, density=250.0)
            self._show(links[body.name].entity, body)
            if body.joint is None and fixed:
                _mark_fixed(links[body.name])
            elif body.joint is not None and body.joint.sprung:
                links[body.name].disable_gravity = True
        joints = {joint.name.removeprefix(f"{name}/"): k for k, joint in enumerate(articulation.active_joints)}
        entities = {body: link.entity for body, link in links.items()}
        return Thing(name, synset, description, entities, articulation, not fixed, _joints=joints)

    def _add(self, builder: sapien.ActorBuilder, body: RigidBody, friction: float, density: float = 1000.0) -> None:
        """Add a body's collision shapes."""
        handles = [handle.center for handle in body.handles]
        for part in body.parts:
            solid = part.solid
            pose, half = sapien.Pose(solid.T), solid.half_m
            if solid.kind == "cylinder":
                pose = sapien.Pose(matmul(solid.T, _SAPIEN_CYLINDER))
            if part.collides and part.hull is None:
                held = body.joint is not None and any(np.allclose(solid.T[:3, 3], center) for center in handles)
                surface = self._surface(_HANDLE_FRICTION if held else friction)
                if solid.kind == "box":
                    builder.add_box_collision(pose, half, material=surface, density=density)
                elif solid.kind == "cylinder":
                    builder.add_cylinder_collision(pose, half[0], half[2], material=surface, density=density)
                else:
                    builder.add_sphere_collision(pose, half[0], material=surface, density=density)

    def _add_hulls(
        self, component: sapien.physx.PhysxRigidBaseComponent, body: RigidBody, friction: float, density: float = 1000.0
    ) -> None:
        """Add what SAPIEN's builders take from files only: a body's convex parts."""
        for part in body.parts:
            if part.hull is None or not part.collides:
                continue
            shape = sapien.physx.PhysxCollisionShapeConvexMesh(
                vertices=part.hull.astype(np.float32), scale=np.ones(3, np.float32), material=self._surface(friction)
            )
            shape.set_density(density)
            component.attach(shape)

    def _show(self, entity: sapien.Entity, body: RigidBody) -> None:
        """Give an entity what cameras see of a body."""
        if not self.render:
            return
        show(entity, body.parts, self._paint, body.skin)

    def _surface(self, friction: float) -> sapien.physx.PhysxMaterial:
        if friction not in self.surfaces:
            self.surfaces[friction] = sapien.physx.PhysxMaterial(friction, friction, 0.0)
        return self.surfaces[friction]

    def _paint(self, color: Color) -> sapien.render.RenderMaterial:
        if color not in self.paints:
            self.paints[color] = paint(color)
        return self.paints[color]


def paint(color: Color) -> sapien.render.RenderMaterial:
    """A matt paint."""
    linear = [channel**2.2 for channel in color]  # the shaders light in linear color
    return sapien.render.RenderMaterial(base_color=[*linear, 1.0], roughness=_ROUGHNESS, specular=0.1)


def show(
    entity: sapien.Entity,
    parts: Iterable[Part],
    painted: Callable[[Color], sapien.render.RenderMaterial] = paint,
    skin: Iterable[Skin] = (),
) -> None:
    """Give an entity what cameras see of parts in its frame, or of its skin, if it has one."""
    component = sapien.render.RenderBodyComponent()
    for color, mesh in [(s.color, faceted(s)) for s in skin] or meshes(parts):
        no_texture = np.zeros((len(mesh.vertices), 2))
        shape = sapien.render.RenderShapeTriangleMesh(
            mesh.vertices, mesh.triangles, mesh.normals, no_texture, painted(color)
        )
        component.attach(shape)
    entity.add_component(component)


def _weigh(body: sapien.physx.PhysxRigidBodyComponent, mass_kg: float, angular_damping: float) -> None:
    """Give a body another mass, its inertia in proportion."""
    inertia = np.asarray(body.inertia) * (mass_kg / body.mass)
    body.mass = mass_kg
    body.inertia = inertia
    body.set_angular_damping(angular_damping)


def _mark_fixed(component: sapien.physx.PhysxRigidBaseComponent) -> None:
    for shape in component.collision_shapes:
        groups = list(shape.get_collision_groups())
        groups[2] |= 1 << _FIXED_BIT
        shape.set_collision_groups(groups)


def _frame_along(axis: Array, origin: Array) -> Array:
    """(4, 4) frame at `origin` whose x is `axis`: SAPIEN's joints turn about and slide along x."""
    helper = np.array([0.0, 0, 1]) if abs(axis[2]) < 0.9 else np.array([0.0, 1, 0])
    y = np.cross(helper, axis)
    y /= norm(y)
    T = np.eye(4)
    T[:3, :3] = np.stack([axis, y, np.cross(axis, y)], axis=1)
    T[:3, 3] = origin
    return T
