"""Scenes of putting things down: in, on, next to and under."""

from __future__ import annotations

from benchmarks.hands.trial import Scene

SKILLS: dict[str, dict[str, Scene]] = {}
