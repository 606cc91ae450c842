"""The tables of the benchmark over ROS 2."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("rclpy")

from benchmarks.ros2.faults import Trial, rows


def test_a_row_of_faults_counts_reasons_and_what_hung() -> None:
    """Times that were not measured are left out; an end without a reason is one that hung."""
    trials = [Trial("x", 0.2, "silent"), Trial("x", 0.4, "silent"), Trial("x", math.nan, None)]
    assert rows(trials) == [["x", 3, pytest.approx(0.3), 0.4, "silent 2", 1]]
