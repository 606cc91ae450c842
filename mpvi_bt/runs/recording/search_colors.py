"""Colors of drawn searches, and their meaning.

People who tell red from green badly can tell them apart (Okabe and Ito, 2008); shapes and hatches differ besides.
"""

from __future__ import annotations

from mpvi_bt.runs.recording.labels import Color

PAPER: Color = (24, 26, 32)
INK: Color = (20, 22, 28)
ROOM_INK: Color = (62, 66, 76)

SEEN: Color = (250, 250, 246)
IN_VIEW: Color = (248, 240, 150)  # of the floor that was seen
UNSEEN: Color = (158, 166, 180)  # hatched
UNKNOWN: Color = (84, 92, 108)  # hatched both ways
WALL: Color = (8, 9, 12)
FRONTIER: Color = (213, 94, 0)
PATH: Color = (0, 114, 178)
WAY: Color = (110, 110, 110)
FOUND: Color = (204, 121, 167)
ROBOT: Color = (240, 228, 66)
THINGS: tuple[Color, ...] = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (213, 94, 0),
    (204, 121, 167),
)
HATCH = 0.84  # hatches are so much darker than what they lie on
