"""The physical world of one episode: a house, its objects, one robot, and the clock."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.finding.shapes.moving_parts import Door
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.protocols import StepClock
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.assisted import Attachments
from mpvi_bt.house.sim.builder import Thing, build_house, build_object
from mpvi_bt.house.sim.bumps import Bumps
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.dots import Dots
from mpvi_bt.house.sim.holding import TOUCHING_M, Holding
from mpvi_bt.house.sim.lights import Lights
from mpvi_bt.house.sim.looks import ThermalLooks
from mpvi_bt.house.sim.patches import patch_of
from mpvi_bt.house.sim.presence import Presence
from mpvi_bt.house.sim.shaders import PHYSICS_HZ, new_scene
from mpvi_bt.house.sim.sim_robot import SimRobot
from mpvi_bt.house.sim.tying import Ties
from mpvi_bt.house.sim.whereabouts import Whereabouts
from mpvi_bt.house.states.cutting import Blades
from mpvi_bt.house.states.grains import SUBSTANCE, Cooking
from mpvi_bt.house.states.heat import Temperatures
from mpvi_bt.house.states.marks import Marking
from mpvi_bt.house.states.mounts import Mounts
from mpvi_bt.house.states.recipes import Baking
from mpvi_bt.house.states.sprayer import Spraying
from mpvi_bt.house.states.switches import Switches
from mpvi_bt.house.states.temperature import Heat, Thermal
from mpvi_bt.house.states.washer import Washing
from mpvi_bt.house.states.wiping import Wiping
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.house.things.description import Handle

ROBOT = "robot"  # among the names of `SimWorld.contacts`
OVEN_C = 200.0  # Our choice: what is as hot when it is on, and acts on dough, bakes it
GROUND_M = 0.015  # what rises no higher is ground that the base stands on, such as a lawn


@dataclass(frozen=True, eq=False)
class Placement:
    """A movable thing at the start.

    Attributes:
        entry: What it is.
        T_world: (4, 4) its pose.
    """

    entry: CatalogueEntry
    T_world: Array


class SimWorld(StepClock):
    """A house in SAPIEN with a robot in it; also the `WorldState` that goals are judged by, and the expert's `Truth`.

    Attributes:
        robot: The robot; behaviors command it.
        cameras: None where the world was built without rendering.
        bumps: What the robot bumped into, once `measure_bumps` was called; None before.
        phrases: What each movable thing is called, those too that may come to be.
        physics_s: Wall time spent stepping.
    """

    def __init__(
        self,
        house: House,
        objects: Mapping[str, Placement],
        base_pose: Array,
        render: bool = True,
        assisted: bool = False,
        scene: sapien.Scene | None = None,
        robot: RobotDescription = R1,
        future: Mapping[str, CatalogueEntry] | None = None,
    ) -> None:
        """Build everything; nothing has moved yet.

        Args:
            house: Rooms, walls and fixtures.
            objects: Movable things by name, such as "can__of__soda.n.01_1".
            base_pose: (3,) the robot's x, y [m] and yaw [rad].
            render: Whether pictures can be asked for.
            assisted: Whether grasps are assisted: what a closing hand pinches stays in it until the hand opens.
            scene: Where to build it all, with this project's physics and, with `render`, pictures; None: a new one.
            robot: Which robot.
            future: What may come to be of the objects, by its name: halves, dice, what is cooked or baked.

        Raises:
            NoRenderingDevice: `render` was asked for on a machine that cannot.
        """
        self.house = house
        self._scene = new_scene(render) if scene is None else scene
        self._fixtures = build_house(self._scene, house, render)
        future = future or {}
        placed = {**objects, **{n: Placement(e, np.eye(4)) for n, e in future.items()}}
        self._objects = {n: build_object(self._scene, p.entry, n, p.T_world, render) for n, p in placed.items()}
        self._things: dict[str, Thing] = {**self._fixtures, **self._objects}
        self.cameras = Cameras(self._scene) if render else None
        self.robot = self._put_robot(base_pose, robot)
        self._switches = Switches(self._things)
        self._lights = Lights(self._scene, self._switches) if render else None
        if self.cameras is not None and self._lights is not None:
            own = {link.entity.per_scene_id: "robot" for link in self.robot.links.values()}
            things = {entity.per_scene_id: t.name for t in self._things.values() for entity in t.entities.values()}
            self.cameras.names = {**things, **self._lights.labels, **own}
            self.cameras.before = self.show_states
        movable = {n: p.entry for n, p in placed.items()}
        entries = {**{n: f.entry for n, f in house.fixtures.items()}, **movable}
        kinds = {n: e.heat for n, e in entries.items() if e.heat is not None}
        sources = {n: e.source for n, e in entries.items() if e.source is not None}
        self._temperatures = Temperatures(kinds, sources)
        self._grains: dict[str, list[str]] = {}
        for name, entry in movable.items():
            if SUBSTANCE in entry.abilities:
                self._grains.setdefault(entry.synset, []).append(name)
        sprays = Spraying(self._things, {n: e.sprays for n, e in entries.items() if e.sprays is not None})
        washes = Washing({n: e.washes for n, e in entries.items() if e.washes is not None})
        wipes = Wiping(self._things, {n: e.removes for n, e in entries.items() if e.removes is not None})
        self._marking = Marking(self._things, (sprays, washes, wipes))
        self._dots = Dots(self._scene, self._things)
        self._looks = ThermalLooks(self._scene, self._things, kinds) if render else None
        if self.cameras is not None and self._looks is not None:
            self.cameras.names = {**self.cameras.names, **self._looks.labels}
        self._mounting = Mounts(
            Ties(self._scene, self._things), self._things, {n: e.mounts for n, e in entries.items() if e.mounts}
        )
        self._presence = Presence(self._objects, self._things, {n: e.name for n, e in future.items()})
        self._cutting = Blades(self.touches, PHYSICS_HZ, self._presence, movable, self._became)
        self._cooking = Cooking(self._presence, movable, self._became)
        self._baking = Baking(self._presence, movable, self._in_oven, self._became)
        self._holding = Holding(self._scene, self.robot, self._objects, self._things)
        self.phrases = {n: e.phrases for n, e in movable.items()}
        self._whereabouts = Whereabouts(house, self._fixtures, self._objects, self.phrases, self._holding)
        self._attachments = Attachments(self._scene, self.robot, self._objects) if assisted else None
        self.bumps: Bumps | None = None
        self.physics_s = 0.0

    def _put_robot(self, base_pose: Array, model: RobotDescription) -> SimRobot:
        """The robot, once all else is there."""
        return SimRobot(self._scene, base_pose, self.cameras, model)

    # --- the clock

    def step(self) -> None:
        """Carry out the robot's command: one control step, four of physics."""
        started = time.perf_counter()
        self.robot.apply()
        for _ in range(PHYSICS_HZ // CONTROL_HZ):
            self._scene.step()
            if self.bumps is not None:
                self.bumps.update()
        self.stepped()
        self.physics_s += time.perf_counter() - started

    def stepped(self) -> None:
        """See to all that is due after the physics of a control step."""
        self.steps += 1
        if self._attachments is not None:
            self._attachments.step(self.pinched)
        self._switches.step(self.robot.hands_world(), self.robot.fingertips_world)
        self._temperatures.step(self, 1 / CONTROL_HZ)
        self._marking.step(self)
        self._mounting.step(self)
        if self._presence.changes:
            self._cutting.step(1 / CONTROL_HZ)
            self._cooking.step(self)
            self._baking.step(self)

    def _in_oven(self, name: str) -> bool:
        """Whether an oven that is on acts on a thing."""
        return any(source.switched and source.at_c >= OVEN_C for source in self._temperatures.acting(name))

    def _became(self, name: str, made: str) -> None:
        """Pass the states of a thing on to the thing made from it."""
        if self._attachments is not None:
            self._attachments.lose(name)
        self._temperatures.inherit(made, name)
        self._whereabouts.forget()
        self.robot.forget()

    def measure_bumps(self, carried: Collection[str] = ()) -> Bumps:
        """Measure from now on how hard the robot bumps into walls and fixtures; it costs time in each physics step.

        Args:
            carried: Movable things that count as the robot's own parts: what it holds.
        """
        robot = [link.entity for link in self.robot.links.values()]
        robot += [entity for name in carried for entity in self._objects[name].entities.values()]
        house = {n: t.entities.values() for n, t in self._fixtures.items() if not n.startswith("floor_")}
        self.bumps = Bumps(self._scene, robot, house, 1 / PHYSICS_HZ)
        return self.bumps

    def settle(self, seconds: float = 1.0) -> None:
        """Let everything come to rest before the episode begins; does not advance its clock."""
        for _ in range(round(seconds * PHYSICS_HZ)):
            self._scene.step()
        self.refresh()

    def refresh(self) -> None:
        """Have physics report every contact anew: it falls silent about what sleeps. Costs one physics step."""
        self.wake()
        self._scene.step()
        self.robot.forget()
        self._whereabouts.forget()

    def wake(self) -> None:
        """Have the next step report the contacts of what sleeps, too."""
        for thing in self._things.values():
            if thing.movable:
                thing.wake()

    def set_opening(self, name: str, body: str, fraction: float) -> None:
        """Put a door or drawer of a fixture at an opening, 0 closed to 1 fully open, at rest.

        Raises:
            UnknownName: There is no such thing, or no such moving body of it.
        """
        if name not in self._things:
            raise UnknownName("thing", name, self._things)
        moving = [b.name for b in self._things[name].description.bodies if b.joint is not None]
        if body not in moving:
            raise UnknownName("moving body", body, moving, where=name)
        self._things[name].set_joint_fraction(body, fraction)

    def turn(self, name: str, on: bool) -> None:
        """Turn a thing that has a switch on or off.

        Raises:
            UnknownName: There is no such thing with a switch.
        """
        if name not in self._switches.on:
            raise UnknownName("thing with a switch", name, self._switches.on)
        self._switches.turn({name: on})

    def mark(self, name: str, kind: str) -> None:
        """Cover a thing with marks of a kind, such as "dust.n.01"; of a floor a patch where there is room for it.

        Raises:
            UnknownName: There is no such thing.
        """
        if name not in self._things:
            raise UnknownName("thing", name, self._things)
        solids = self.solids(name)
        if name.startswith("floor_"):
            base = self.robot.proprioception().base_pose[:2]
            patch = patch_of(name, kind, solids, base, self.obstacles)
            self._things[patch.name], solids = patch, patch.solids()
            self._whereabouts.patches[patch.name] = patch
        self._marking.put(name, kind, solids)

    def show_states(self) -> None:
        """Bring what cameras see of switches, marks and heat to how they are."""
        if self._lights is not None:
            self._lights.show()
        if self._looks is not None:
            self._looks.show(self.heat)
        if (new := self._dots.show(self._marking.marks)) and self.cameras is not None:
            self.cameras.names = {**self.cameras.names, **new}

    @property
    def switched(self) -> dict[str, bool]:
        """Whether each thing that has a switch is on."""
        return self._switches.on

    def place(self, name: str, T: Array, fixed: bool = False) -> None:
        """Put a movable thing at `T` (4, 4, body to world), at rest.

        Args:
            name: The thing.
            T: Where.
            fixed: Nothing moves it from there until it is placed anew.

        Raises:
            UnknownName: There is no such movable thing.
            UserError: It has joints, and is to be fixed.
        """
        if name not in self._objects:
            raise UnknownName("movable thing", name, self._objects)
        thing = self._objects[name]
        if thing.articulation is None:
            thing.rigid_body.kinematic = fixed
        elif fixed:
            raise UserError(f"{name} cannot be fixed: it has joints")
        thing.place(T)
        self._whereabouts.forget()

    def save(self) -> dict[str, Any]:
        """How everything stands, as JSON values: the robot, and every thing that can move."""
        things = {name: thing.motion() for name, thing in self._things.items() if thing.moves}
        return {"steps": self.steps, "robot": self.robot.save(), "things": things, "on": self._switches.on,
                "whereabouts": self._whereabouts.save(), "heat": self._temperatures.save(),
                "marks": self._marking.save(), "mounted": self._mounting.save(), "presence": self._presence.save(),
                "blades": self._cutting.save()}  # fmt: skip

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring everything to how it stood. Contacts are found anew, so what follows is close to, not the same as,
        what would have followed.

        Raises:
            UserError: Other things were saved than there are here.
        """
        self._presence.restore(saved.get("presence", {}))
        movable = {name for name, thing in self._things.items() if thing.moves}
        if set(saved["things"]) != movable:
            odd = sorted(movable.symmetric_difference(saved["things"]))
            raise UserError(f"the saved world has not the same things as this one: {', '.join(odd[:5])}")
        if self._attachments is not None:  # what the hands hold then is found anew, by touch
            self._attachments.release()
        for name, motion in saved["things"].items():
            self._things[name].set_motion(motion)
        self.robot.restore(saved["robot"])
        self._switches.turn(saved.get("on", {}))
        self._whereabouts.restore(saved.get("whereabouts", {}))
        self._temperatures.restore(saved.get("heat", {}))
        self._marking.restore(saved.get("marks", {}))
        self._mounting.restore(saved.get("mounted", {}))
        self._cutting.restore(saved.get("blades", {}))
        self.steps = int(saved["steps"])

    @property
    def scene(self) -> sapien.Scene:
        """The simulator's, for those who draw it."""
        return self._scene

    def look_from(self, T_world_camera: Array, size: tuple[int, int] = (640, 480), fov_rad: float = 1.0) -> CameraImage:
        """A picture from anywhere, (4, 4) optical frame to world. Raises NoRenderingDevice without rendering."""
        if self.cameras is None:
            raise Cameras.missing()
        return self.cameras.look_from(T_world_camera, size, fov_rad)

    # --- WorldState

    def exists(self, name: str) -> bool:
        """Whether the thing is in the world."""
        return name in self._things

    def solids(self, name: str) -> Sequence[Solid]:
        """Its collision solids in the world."""
        return self._things[name].solids()

    def volumes(self, name: str) -> Sequence[Solid]:
        """Its container volumes in the world."""
        return self._things[name].volumes()

    def touching(self, name: str, other: str) -> bool:
        """Whether the last physics step reported a contact between the two; see `refresh`."""
        mine, theirs = (set(self._things[n].entities.values()) for n in (name, other))
        for contact in self._scene.get_contacts():
            a, b = (body.entity for body in contact.bodies)
            if ((a in mine and b in theirs) or (a in theirs and b in mine)) and any(
                p.separation < TOUCHING_M for p in contact.points
            ):
                return True
        return False

    def touches(self, name: str, others: Collection[str]) -> Iterator[tuple[str, Sequence[tuple[Array, Array]]]]:
        """Each contact of a thing with one of some others in the last physics step, as of `Touches`."""
        own, near = self._things[name].entity, {self._things[other].entity: other for other in others}
        for contact in self._scene.get_contacts():
            a, b = (body.entity for body in contact.bodies)
            other = near.get(b if a == own else a) if own in (a, b) else None
            if other is not None:
                yield other, [(np.asarray(p.position), np.asarray(p.impulse, float)) for p in contact.points]

    def contacts(self) -> Iterator[tuple[str, str, float]]:
        """Names and depth [m] of the pairs that the last physics step reported in contact; the robot is `ROBOT`."""
        names = {entity: t.name for t in self._things.values() for entity in t.entities.values()}
        names |= {link.entity: ROBOT for link in self.robot.links.values()}
        for contact in self._scene.get_contacts():
            a, b = (names.get(body.entity, "") for body in contact.bodies)
            if a != b and contact.points:
                yield a, b, -min(float(p.separation) for p in contact.points)

    def joint_fractions(self, name: str) -> Sequence[float]:
        """Opening of its joints, 0 to 1."""
        return self._things[name].joint_fractions()

    def toggled_on(self, name: str) -> bool:
        """Whether it is turned on; False for what has no switch."""
        return self._switches.on.get(name, False)

    def covered(self, name: str, kind: str) -> bool:
        """Whether there are marks of a kind on it."""
        return self._marking.covered(name, kind)

    def grains(self, kind: str) -> Sequence[str]:
        """Names of the grains of a substance that there are."""
        return [name for name in self._grains.get(kind, ()) if name in self._objects]

    def marked(self, name: str) -> bool:
        """Whether there are marks of any kind on a thing; a patch on a floor has those of its floor."""
        return self._marking.marked(name.partition(".")[0] if name in self._whereabouts.patches else name)

    def attached(self, name: str, other: str) -> bool:
        """Whether a thing is mounted on another one."""
        return self._mounting.attached(name, other)

    def heat(self, name: str) -> tuple[Heat, Thermal]:
        """How warm it is, and what heat does to it."""
        return self._temperatures.of(name)

    # --- Truth

    @property
    def things(self) -> Sequence[str]:
        """Names of everything but the robot: floors and walls, fixtures, movable things."""
        return list(self._things)

    @property
    def objects(self) -> Sequence[str]:
        """Names of the movable things."""
        return list(self._objects)

    def thing(self, name: str) -> Thing:
        """A thing, by its name."""
        return self._things[name]

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4)."""
        return self._things[name].T_world_body()

    def handles(self, name: str) -> Sequence[Handle]:
        """Bars to carry it by, in the world: not those of its doors and lids."""
        thing = self._things[name]
        return [handle.moved(thing.T_world_body()) for handle in thing.description.root.handles]

    def doors(self, name: str) -> Sequence[Door]:
        """Its doors, lids and drawers in the world, as they stand now."""
        thing = self._things[name]
        out = []
        for body, fraction in zip((b for b in thing.description.bodies if b.joint), self.joint_fractions(name),
                                  strict=True):  # fmt: skip
            joint = body.joint
            assert joint is not None
            T = thing.T_world_body()
            origin, axis = matmul(T[:3, :3], joint.origin) + T[:3, 3], matmul(T[:3, :3], joint.axis)
            now = thing.T_world_body(body.name)
            solids = [part.solid.moved(now) for part in body.parts if part.collides]
            bar = body.handles[0].moved(now) if body.handles else None
            out.append(Door(body.name, joint.kind, origin, axis, fraction * joint.limit, joint.limit, bar, solids))
        return out

    def mounts(self, name: str) -> Sequence[Mount]:
        """Its mounts, in the world."""
        return self._mounting.of(name)

    def switches(self, name: str) -> Sequence[Array]:
        """T_world_switch (4, 4) of its switches, z pointing out of the thing."""
        return self._switches.of(name)

    def holding(self, side: Side) -> str | None:
        """The movable thing between the fingers of one hand."""
        return self._holding.in_hand(side)

    def pinched(self, side: Side) -> list[str]:
        """The movable things that both fingers of one hand touch, by the contacts of the last physics step."""
        return self._holding.pinched(side)

    def between(self) -> str | None:
        """The movable thing pressed between both hands."""
        return self._holding.between()

    def within(self, name: str) -> Sequence[str]:
        """Movable things whose middle lies in the container volumes of a thing."""
        return self._holding.within(name)

    def obstacles(self, xy: Array, radius_m: float, without: Collection[str] = ()) -> list[Solid]:
        """Solids of walls, fixtures and objects that come within `radius_m` of a place on the floor (2,)."""
        out = [w.solid for w in self.house.walls]
        for name in (*self._objects, *self.house.fixtures):
            if name not in without:
                out += self._things[name].solids()
        place = np.asarray(xy, float)[:2]
        near = []
        for solid in out:
            low, high = solid.aabb()
            if norm(np.maximum(np.maximum(low[:2] - place, place - high[:2]), 0)) < radius_m and high[2] > GROUND_M:
                near.append(solid)
        return near

    def knowledge(self) -> KnowledgeBase:
        """Where everything is now, by the simulator (the `oracle` detector)."""
        return self._whereabouts.at(self.steps)
