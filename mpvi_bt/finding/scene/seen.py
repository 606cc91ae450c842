"""The scene as the cameras have shown it: what the reactive policy works with. No simulator state comes near it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.finding.scene.associator import Associator
from mpvi_bt.finding.scene.frames import Pictures
from mpvi_bt.finding.scene.free_space import FreeSpace, Standing
from mpvi_bt.finding.scene.hand_history import HandHistory
from mpvi_bt.finding.scene.handling import Handling
from mpvi_bt.finding.scene.hands import HandTracker
from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.finding.scene.seen_parts import SeenParts
from mpvi_bt.finding.scene.thing_store import SeenThing, ThingStore
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side


class Seen:
    """A `mpvi_bt.finding.scene.scene.Scene` of pictures.

    Pictures and proprioception go to `Associator` and `Handling`, which change the store of things. `SeenParts` and
    `FreeSpace` answer questions about it. All but `history` and what stands around begins anew with each prompt.

    Attributes:
        things: What was seen or felt since the last prompt began.
        space: What is in the way.
        history: What the hands have done under any prompt.
    """

    needs_looks = True
    pose_error_m = 0.06  # our choice: fits are off by some centimeters, and odometry after a drive by as much again

    def __init__(self, detector: Detector, standing: Standing | None = None) -> None:
        """See through `detector`; `standing` tells of obstacles outside the pictures given to `see`."""
        self._detector, self._standing = detector, standing
        self._hands, self._remembered, self.history = HandTracker[Shape](), Remembered(), HandHistory()
        self._begin(())

    def forget(self, phrases: Iterable[str]) -> None:
        """Forget all things and look for `phrases` from now on, of which no two mean the same things.

        A payload is known again once a picture shows it in the hand.
        """
        self._handling.keep_payloads()
        self._begin(tuple(dict.fromkeys(phrases)))

    def _begin(self, phrases: Sequence[str]) -> None:
        self.things = things = ThingStore(self._hands)
        self._pictures = pictures = Pictures(self._detector, phrases)
        parts = SeenParts(things, pictures)
        self._handling = Handling(things, pictures, parts, self.history, self._remembered)
        self._associator = Associator(things, phrases, parts, self._handling)
        self.space = FreeSpace(things, pictures, parts, self._remembered, self._standing)
        self.pose, self.solids, self.body, self.volumes = parts.pose, parts.solids, parts.body, parts.volumes
        self.handles, self.doors, self.switches, self.is_on = parts.handles, parts.doors, parts.switches, parts.is_on
        self.others, self.within, self.covered = parts.others, things.within, self.history.covered
        self.obstacles, self.passable = self.space.obstacles, self.space.passable
        self.spots, self.trusting = self.space.spots, self.space.trusting
        self.recognized = self._handling.recognized

    def feel(self, felt: Proprioception) -> None:
        """Take in one step of proprioception: motion of the base, grasps and releases."""
        self._pictures.feel(felt)
        self._handling.feel(felt)

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """Take in pictures."""
        self.feel(felt)
        for image in images.values():
            frame = self._pictures.add(image, felt)
            self._associator.associate(frame)
            if image.camera == "head":
                self._remembered.see(frame.image, frame.measured & ~self._associator.loose(frame))
        self._handling.find_payloads(felt)
        self._associator.fill_vessels()

    def knowledge(self) -> KnowledgeBase:
        """As `Scene` says."""
        base = KnowledgeBase()
        for thing in self.things:
            base.put(self._entry(thing))
        return base

    def _entry(self, thing: SeenThing) -> Entry:
        low, high = self.things.shape(thing.name).box()
        held = self.things.is_carried(thing)
        laid = not held and self.history.is_laid(thing.phrase, (low + high) / 2)
        put = self.history.put_into((low + high) / 2) if thing.shape.kind == "vessel" and not held else ()
        kind: Literal["fixture", "object"] = "fixture" if thing.shape.kind == "furniture" else "object"
        return Entry(thing.name, (thing.phrase,), kind, low, high, source=self._detector.name, held=held,
                     inside=thing.inside, laid=laid, filled=tuple(put))  # fmt: skip

    def mounts(self, name: str) -> Sequence[Mount]:
        """None: no picture tells where a thing fits another."""
        return ()

    def holding(self, side: Side) -> str | None:
        """As `Scene` says: what was nearest to the hand when it closed, as long as its fingers feel something."""
        return self._hands.held(side)

    def between(self) -> str | None:
        """As `Scene` says: what was nearest to both hands when something began to keep them apart."""
        return self._hands.held("both")

    def laden(self, name: str) -> bool:
        """As `Scene` says: by known contents, or by contents put in under an earlier prompt."""
        return bool(self.within(name)) or any(self._hands.held(hand) == name for hand in self.history.laden)
