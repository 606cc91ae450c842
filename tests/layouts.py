"""The numbers of our robots' actions, for tests: all of them have those of the r1."""

from __future__ import annotations

from mpvi_bt.hands.robots.r1 import R1

LAYOUT = R1.layout
ACTION_SIZE = LAYOUT.size
BASE = slice(0, 3)  # vx, vy [m/s] and yaw rate [rad/s]
CAMERAS = tuple(R1.cameras)
