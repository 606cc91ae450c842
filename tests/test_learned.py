"""The learned policy: its features, weights, points and what it says it cannot do."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.hands.learned import mirroring
from mpvi_bt.hands.learned.acting import chunk
from mpvi_bt.hands.learned.demonstration import Demonstration
from mpvi_bt.hands.learned.features import WAYPOINT, WAYPOINT_SIZE, WAYPOINTS, TargetFrame, bases, hand_at
from mpvi_bt.hands.learned.learned_hand import LearnedHand
from mpvi_bt.hands.learned.network import Networks, Weights
from mpvi_bt.hands.learned.points import PointMemory
from mpvi_bt.hands.learned.policy import WEIGHTS, LearnedPolicy
from mpvi_bt.hands.robots.r1 import R1, TRAVEL_TORSO
from mpvi_bt.testing.contracts import check_policy
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import LAYOUT

SKILLS = load_skills()
VOCABULARY = {"can.n.01_1": ("can",), "robot": ("robot",)}
angles = st.floats(-1.0, 1.0)


def policy(**options):
    return LearnedPolicy(SKILLS, SegmentationDetector(VOCABULARY, least_px=1), **options)


def picture(labels, depth=1.0, camera="head"):
    h, w = labels.shape
    K = np.array([[50.0, 0, w / 2], [0, 50.0, h / 2], [0, 0, 1]])
    names = {1: "can.n.01_1", 2: "robot"}
    shown = np.full((h, w), depth, np.float32)
    return CameraImage(camera, np.zeros((h, w, 3), np.uint8), shown, labels, names, K, np.eye(4))


def observed(prompt, images=None, robot=None):
    felt = (robot or KinematicRobot()).proprioception()
    return {"prompt": prompt, "proprioception": felt, "images": images or {}}


@given(st.lists(angles, min_size=7, max_size=7), angles)
def test_a_mirrored_arm_brings_the_other_hand_to_the_mirrored_place(q, waist):
    """Whatever the joints, mirroring them mirrors the hand's pose: one hand's weights serve both."""
    torso = TRAVEL_TORSO + [0, waist, 0, 0]
    M = np.diag([1.0, -1.0, 1.0, 1.0])
    left = R1.tcp(torso, np.array(q), "left")
    right = R1.tcp(mirroring.torso(torso), mirroring.arm(np.array(q)), "right")
    assert np.allclose(M @ left @ M, right)


@given(st.lists(angles, min_size=14, max_size=14), st.lists(angles, min_size=3, max_size=3))
def test_a_stance_comes_back_from_its_hypothesis(numbers, base):
    """What the proposer learns to say stands for the stance that was demonstrated, and its hand pose."""
    stance = np.array(numbers)[None]
    points = np.random.default_rng(0).normal(2.0, 0.1, (1, 8, 3))
    frame = TargetFrame.of(np.array(base)[None], points, 4)
    back, hands = frame.stance(frame.hypothesis(stance))
    assert np.allclose(bases(back[:, :3]), bases(stance[:, :3]))
    assert np.allclose(back[:, 3:], stance[:, 3:])
    assert np.allclose(hands, hand_at(stance))


def test_a_demonstration_comes_back_from_its_file(tmp_path: Path):
    """What was recorded is what is trained on."""
    rng = np.random.default_rng(0)
    sizes = {"base": (5, 3), "velocity": (5, 3), "torso": (5, 4), "arm": (5, 7), "width": (5,), "action": (5, 23)}
    kept = {name: rng.random(size).astype(np.float32).astype(float) for name, size in sizes.items()}
    shown = Demonstration(**kept, points=np.ones((2, 128, 3)), look=np.array([-1, 0, 0, 1, 1]))
    shown.save(tmp_path / "1.npz")
    read = Demonstration.load(tmp_path / "1.npz")
    assert all(np.array_equal(getattr(read, name), getattr(shown, name)) for name in (*sizes, "points", "look"))


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("arm", np.full((5, 7), np.nan)),
        ("look", np.full(5, 2)),
        ("points", np.ones((2, 16, 3))),
        ("action", np.ones(5)),
    ],
)
def test_a_demonstration_that_cannot_be_is_refused(tmp_path: Path, name: str, array: np.ndarray):
    """Numbers that are none, samples that are not there, another shape: nothing is trained on them."""
    sizes = {"base": (5, 3), "velocity": (5, 3), "torso": (5, 4), "arm": (5, 7), "width": (5,), "action": (5, 23)}
    kept = {n: np.zeros(size) for n, size in sizes.items()} | {"points": np.ones((2, 128, 3)), "look": np.zeros(5)}
    Demonstration(**{**kept, name: array}).save(tmp_path / "1.npz")
    with pytest.raises(UserError, match=rf"1\.npz: {name} "):
        Demonstration.load(tmp_path / "1.npz")


def test_what_the_left_hand_demonstrates_is_kept_as_if_the_right_one_did_it():
    """Training reads the right hand's columns: there are the left one's commands and posture, mirrored."""
    rng = np.random.default_rng(0)
    action, points = rng.random((1, 23)), rng.random((1, 128, 3))
    base, torso, arm = action[:, :3], action[:, LAYOUT.torso], action[:, LAYOUT.arm["left"]]
    shown = Demonstration(base, base, torso, arm, np.ones(1), action, points, np.zeros(1)).mirrored()
    assert np.allclose(shown.arm, shown.action[:, LAYOUT.arm["right"]])
    assert np.allclose(shown.torso, shown.action[:, LAYOUT.torso])
    assert shown.action[0, LAYOUT.gripper["right"]] == action[0, LAYOUT.gripper["left"]]
    M = np.diag([1.0, -1.0, 1.0, 1.0])
    hand = bases(shown.base)[0] @ R1.tcp(shown.torso[0], shown.arm[0], "right")
    assert np.allclose(hand, M @ bases(base)[0] @ R1.tcp(torso[0], arm[0], "left") @ M)
    assert np.allclose(shown.points, points * [1, -1, 1])
    assert np.allclose(shown.mirrored().action, action)


def test_shipped_weights_are_small():
    """They go into every wheel: at most 5 MB."""
    assert WEIGHTS.stat().st_size < 5e6


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_weights_that_are_cut_off_are_refused_in_one_line(tmp_path: Path, share: float):
    """A download that broke off is told as such, before anything moves."""
    data = WEIGHTS.read_bytes()
    (cut := tmp_path / "w.npz").write_bytes(data[: int(share * len(data))])
    with pytest.raises(UserError, match=r"w\.npz: no whole file of weights") as raised:
        policy(weights=cut)
    assert "\n" not in str(raised.value)


def test_weights_with_a_hole_are_refused_in_one_line(tmp_path: Path):
    """Zeros within a compressed array, as a disk leaves that was not synced, are no end of the program."""
    data = bytearray(WEIGHTS.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 4096] = bytes(4096)
    (broken := tmp_path / "w.npz").write_bytes(data)
    with pytest.raises(UserError, match=r"w\.npz: no whole file of weights") as raised:
        Weights.load(broken)
    assert "\n" not in str(raised.value)


def test_weights_of_another_version_are_refused_with_both_versions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Features that changed since would make nonsense of them."""
    weights = Weights.load(WEIGHTS)
    monkeypatch.setattr("mpvi_bt.hands.learned.network.VERSION", 99)
    weights.save(tmp_path / "w.npz")
    monkeypatch.undo()
    with pytest.raises(UserError, match="version 99; this mpvi_bt runs version 1"):
        Weights.load(tmp_path / "w.npz")


@pytest.mark.parametrize("prompt", ["wipe the table", "open the fridge", "pick up the can and put it in the bin", "?"])
def test_what_it_never_learned_it_says_at_once(prompt: str):
    """Whoever has a second policy loses no time; the robot stands still."""
    hands, robot = policy(), KinematicRobot()
    chunk = hands.infer(observed(prompt, robot=robot))
    assert hands.gave_up
    assert hands.note.startswith("no_skill")
    assert np.allclose(chunk[:, :3], 0)
    assert np.allclose(chunk[:, 7:], np.repeat(robot.action[None, 7:], len(chunk), 0))


def test_another_robot_is_no_skill(monkeypatch: pytest.MonkeyPatch):
    """Weights move the robot that they were learned with, no other."""
    hands = policy()
    seen = observed("pick up the can")
    hands.infer({**seen, "proprioception": replace(seen["proprioception"], robot="r1pro")})
    assert hands.gave_up
    assert "r1, not r1pro" in hands.note


@pytest.mark.parametrize("missing", ["labels", "depth", "thing"])
def test_what_no_picture_shows_is_given_up_without_moving_an_arm(missing: str):
    """Without labels, depth or the thing itself in view it looks about, then says what it did not find."""
    hands, robot = policy(), KinematicRobot()
    image = picture(np.zeros((24, 32), np.int32))
    if missing == "labels":
        image = replace(image, labels=None)
    if missing == "depth":
        image = replace(picture(np.ones((24, 32), np.int32)), depth=np.zeros((24, 32), np.float32))
    arms = robot.action[7:]
    for _ in range(10):
        for action in hands.infer(observed("pick up the can", dict.fromkeys(hands.cameras, image), robot)):
            assert np.allclose(action[7:], arms)
            assert np.allclose(action[:3], 0)
            robot.advance(action)
    assert hands.gave_up
    assert hands.note == "not_found: 'can'"


def test_a_hand_that_holds_something_is_not_taken():
    """Whoever is told to use a full hand says so, and lets nothing fall."""
    hands, seen = (
        policy(),
        observed("pick up the can with the right hand", {"head": picture(np.ones((24, 32), np.int32))}),
    )
    felt = seen["proprioception"]
    full = replace(felt, gripper_width={"left": 0.1, "right": 0.05}, gripper_command={"left": 1.0, "right": -1.0})
    for _ in range(2):
        (*_, last) = hands.infer({**seen, "proprioception": full})
    assert hands.gave_up
    assert hands.note == "no_skill: to set down what is in the hand"
    assert last[22] == -1.0


def test_points_of_the_target_are_on_it_and_those_of_the_rest_are_not():
    """Of 128 points the first half lies on what the phrase names, the second half on what is around it."""
    labels = np.zeros((24, 32), np.int32)
    labels[8:16, 12:20] = 1
    labels[20:, :] = 2  # the robot is neither
    memory = PointMemory(SegmentationDetector(VOCABULARY, least_px=1), "can", np.random.default_rng(0))
    memory.look(picture(labels, depth=0.4))
    points = memory.sample()
    on = (np.abs(points[:, 0]) <= 0.033) & (np.abs(points[:, 1]) <= 0.033)
    assert points.shape == (128, 3)
    assert on[:64].all()
    assert not on[64:].any()
    assert (points[64:, 1] < 0.4 * (20 - 12) / 50).all()


def test_a_picture_half_on_the_target_and_half_on_the_wall_shows_one_of_them():
    """Where as many pixels are of something far behind, the middle depth is one that was measured, so points remain."""
    labels = np.zeros((24, 32), np.int32)
    labels[8:16, 12:20] = 1
    depth = np.full((24, 32), 0.4, np.float32)
    depth[:, 16:] = 1.4
    memory = PointMemory(SegmentationDetector(VOCABULARY, least_px=1), "can", np.random.default_rng(0))
    memory.look(replace(picture(labels), depth=depth))
    assert np.ptp(memory.sample()[:64, 2]) < 0.3


def test_what_a_hand_carries_is_not_looked_for():
    """A can in the bin that the robot holds is not the one to be picked up."""
    labels = np.ones((24, 32), np.int32)
    memory = PointMemory(SegmentationDetector(VOCABULARY, least_px=1), "can", np.random.default_rng(0))
    memory.look(picture(labels), carried=[np.array([0.0, 0.0, 1.0])])
    assert not memory.seen


@pytest.mark.parametrize(("skill", "prompt"), [("pick", "pick up the can"), ("place_in", "put the cup in the can")])
def test_what_is_larger_than_what_was_trained_on_is_no_skill(tmp_path: Path, skill: str, prompt: str):
    """Who learned to pick up cans and to fill baskets says at once that a fridge is neither."""
    weights = Weights.load(WEIGHTS)
    replace(weights, skills={skill: weights.skills["pick"]}).save(tmp_path / "w.npz")
    hands = policy(weights=tmp_path / "w.npz")
    seen = observed(prompt, {"head": picture(np.ones((24, 32), np.int32), depth=3.0)})
    if skill == "place_in":
        full = {"gripper_width": {"left": 0.1, "right": 0.05}, "gripper_command": {"left": 1.0, "right": -1.0}}
        seen["proprioception"] = replace(seen["proprioception"], **full)
    hands.infer(seen)
    assert hands.gave_up
    assert hands.note.startswith("no_skill: the can is larger")


def test_it_keeps_the_policy_contract():
    """As any policy of another package has to."""
    check_policy(policy())


def test_it_runs_without_torch():
    """Torch is for training: importing and loading the policy does not import it."""
    code = (
        "import sys; from mpvi_bt.hands.learned.policy import LearnedPolicy, WEIGHTS; "
        "from mpvi_bt.hands.learned.network import Weights; Weights.load(WEIGHTS); sys.exit('torch' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_place_without_a_payload_is_given_up_at_once(tmp_path: Path):
    """Whoever is told to put down what no hand holds says so, and moves no arm."""
    weights = Weights.load(WEIGHTS)
    replace(weights, skills={"place_next_to": weights.skills["pick"]}).save(tmp_path / "w.npz")
    hands, robot = policy(weights=tmp_path / "w.npz"), KinematicRobot()
    image = picture(np.ones((24, 32), np.int32))
    for _ in range(2):
        rows = hands.infer(observed("put the cup next to the can", {"head": image}, robot))
    assert hands.gave_up
    assert hands.note.startswith("not_held")
    assert np.allclose(rows[:, 7:], robot.action[7:])


def test_the_hand_that_holds_the_payload_puts_it_down(tmp_path: Path):
    """Of a place, the hand that holds the payload moves, and the other one keeps still."""
    weights = Weights.load(WEIGHTS)
    replace(weights, skills={"place_next_to": weights.skills["pick"]}).save(tmp_path / "w.npz")
    hands = policy(weights=tmp_path / "w.npz")
    rows = list(itertools.islice(placing(hands), 20))
    assert all(np.allclose(row[:, 7:14], rows[0][0, 7:14]) for row in rows)
    assert hands.note == "place_next_to can, right hand"
    assert np.abs(rows[-1][-1] - rows[0][0])[15:22].max() > 0


def test_a_hand_that_rests_at_its_pose_opens(tmp_path: Path):
    """Also where the actor never thinks of it; else it would hold the payload there until the time is over."""
    weights = Weights.load(WEIGHTS)
    networks = dict(weights.skills["pick"].weights)
    last = max((n for n in networks if re.match(r"actor\.trunk\.\d+\.bias", n)), key=lambda n: int(n.split(".")[2]))
    bias = networks[last].copy()
    bias[:-1].reshape(WAYPOINTS, WAYPOINT_SIZE)[:, WAYPOINT["grip"]] = -100.0
    skills = {"place_next_to": Networks({**networks, last: bias})}
    replace(weights, skills=skills).save(tmp_path / "w.npz")
    chunks = itertools.islice(placing(policy(weights=tmp_path / "w.npz")), 90)
    told = [float(rows[-1, LAYOUT.gripper["right"]]) for rows in chunks]
    assert told[:10] == [-1.0] * 10
    assert max(told) == 1.0


def placing(hands):
    """Every chunk of a policy whose right hand holds a cup and is to put it next to a can before the robot."""
    labels = np.zeros((24, 32), np.int32)
    labels[10:14, 14:18] = 1
    T_world_camera = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0.8], [0, 0, 0, 1.0]])
    image = replace(picture(labels, depth=0.9), T_world_camera=T_world_camera)
    robot, grip = KinematicRobot(), -1.0
    while True:
        seen = observed("put the cup next to the can", {"head": image}, robot)
        felt = replace(
            seen["proprioception"],
            gripper_width={"left": 0.1, "right": max(0.05, (grip + 1) / 2 * 0.1)},
            gripper_command={"left": 1.0, "right": grip},
        )  # fmt: skip
        rows = hands.infer({**seen, "proprioception": felt})
        yield rows
        for action in rows:
            robot.advance(action)
        grip = float(rows[-1, LAYOUT.gripper["right"]])


@given(st.floats(-1.0, 1.0), st.floats(0.1, 0.5))
@settings(max_examples=10)
def test_a_payload_is_let_go_of_only_at_its_stance(heading: float, far_m: float):
    """Whatever the actor answers, a base that is not there drives there first, the arm at rest and the hand closed."""
    way = far_m * np.array([np.cos(heading), np.sin(heading), 0.0])
    now, steps = placed(way, higher_m=-0.3)
    for base, _, arm, grip in steps:
        assert base @ way > 0
        assert np.allclose(arm, now.told_arm[0])
        assert grip == -1.0


def test_a_payload_is_raised_over_what_is_higher_before_the_base_drives():
    """A container on a table would strip it off a hand that is driven against it."""
    now, steps = placed(np.array([0.3, 0.0, 0.0]), higher_m=0.1)
    last = replace(now, arm=steps[-1][2][None])
    assert last.hands[0, 2, 3] > now.hands[0, 2, 3] + 0.01
    assert all(not base.any() for base, *_ in steps)


def placed(way, higher_m):
    """One moment and the steps from it to a stance that is a way (3,) off, its hand so much higher."""
    felt = replace(KinematicRobot().proprioception(), gripper_command={"left": 1.0, "right": -1.0})
    now = LearnedHand("right", felt).now()
    stance = np.concatenate([now.base[0] + way, now.torso[0] + [higher_m, 0.0, 0.0, 0.0], now.arm[0]])[None]
    points = np.random.default_rng(0).normal([0.8, 0.0, 0.5], 0.05, (128, 3))
    return now, chunk(Weights.load(WEIGHTS).skills["pick"], now, stance, points, before=True, opens=True)[0]
