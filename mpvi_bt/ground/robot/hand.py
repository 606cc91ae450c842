"""A hand with two fingers, as a value: what of it may touch things is known before any arm is thought of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True, eq=False)
class Hand:
    """The bare hand in its tcp frame: z along the fingers, y across them, origin between their pads.

    Attributes:
        travel_m: Of each finger; the hand opens twice that.
        tip_m: The fingertips reach this far past the tcp.
        finger_half_m: Half a finger's thickness: from its pad to its middle.
        tip_half_m: Half a fingertip's breadth, along x.
        finger_z_m: (n,) heights of spheres along a finger.
        finger_m: Radius of those.
        palm: (m, 3) centers and (m,) radii of spheres that stand for the palm; they reach a little beyond it.
        wrist: Height and radius of a sphere that stands for the wrist over what a hand that lies flat works on.
        room_m: How far behind the tcp a thing may reach before it meets the palm.
        widest_m: What the open hand takes, with a margin.
        pad_m: From the tcp to the middle of the lower half of the pads, along z.
        palm_reach_m: How far over a vessel's opening the palm reaches from the rim that is pinched.
    """

    travel_m: float
    tip_m: float
    finger_half_m: float
    tip_half_m: float
    finger_z_m: Array
    finger_m: float
    palm: tuple[Array, Array]
    wrist: tuple[float, float]
    room_m: float
    widest_m: float
    pad_m: float
    palm_reach_m: float

    @property
    def opening_m(self) -> float:
        """Between the fingers of the hand that is fully open."""
        return 2 * self.travel_m

    @property
    def closed_half_m(self) -> float:
        """From the tcp to the outside of closed fingers."""
        return 2 * self.finger_half_m

    def fingers(self, opening_m: float) -> tuple[Array, Array]:
        """Centers (n, 3) and radii (n,) [m] of spheres in the fingers of the hand that is so far open."""
        y = min(opening_m, self.opening_m) / 2 + self.finger_half_m
        centers = np.array([(0.0, sign * y, z) for sign in (-1, 1) for z in self.finger_z_m])
        return centers, np.full(len(centers), self.finger_m)

    def command(self, opening_m: float) -> float:
        """The gripper's, -1 closed ... 1 open, for an opening; for any that is too wide, 1."""
        return float(np.clip(2 * opening_m / self.opening_m - 1, -1.0, 1.0))

    def lowest(self, tilt: float) -> float:
        """How high [m] above a surface the tcp stays at least: tips, palm and wrist are clear of it.

        `tilt` is that of the approach from straight down [rad].
        """
        s, c = float(np.sin(tilt)), float(np.cos(tilt))
        centers, radii = self.palm
        palm = float((radii * s + centers[:, 2] * c).max())
        z, wrist = self.wrist
        return 0.004 + max(self.tip_m * c + self.tip_half_m * s, palm, wrist + z * c)
