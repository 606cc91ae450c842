"""Laws of the criteria's language, of the judge that sees and of the oracle; pictures are ray-cast from boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.completion.criteria import MOST_CHARACTERS, Criterion, Relation, named, parse
from mpvi_bt.executive.completion.mistakes import CheckErrors, MistakenChecker
from mpvi_bt.executive.completion.oracle import OracleChecker
from mpvi_bt.executive.plan.skill_phrases import filled
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.finding.perception.visual_checker import VisualChecker
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.kinematics import LINK_TO_OPTICAL, rot_y, transform
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Checker, Judgement
from mpvi_bt.ground.robot.protocol import CameraImage, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.runs.choices.checkers import check_checker_choice, doubt
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.testing import ScriptedChecker, check_checker

PHRASES = {
    "can_1": ("can of soda", "soda can"),
    "can_2": ("can of soda", "soda can"),
    "bin": ("trash can", "ashcan"),
    "table": ("table",),
    "cabinet": ("cabinet",),
    "floor": ("floor",),
}
Box = tuple[str, tuple[float, float, float], tuple[float, float, float]]  # name, lowest and highest corner [m]


def picture(camera: str, T_world_camera: Array, boxes: list[Box], size: int = 160, fov_rad: float = 1.2) -> CameraImage:
    """What a square camera sees of axis-aligned boxes, by intersecting every pixel's ray with every box."""
    focal = size / 2 / np.tan(fov_rad / 2)
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    u, v = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    rays = np.stack([(u - size / 2) / focal, (v - size / 2) / focal, np.ones_like(u)], -1) @ T_world_camera[:3, :3].T
    depth, labels = np.full((size, size), np.inf), np.full((size, size), -1)
    names = dict(enumerate(dict.fromkeys(name for name, _, _ in boxes)))
    ids = {name: i for i, name in names.items()}
    with np.errstate(divide="ignore", invalid="ignore"):
        for name, lowest, highest in boxes:
            a = (np.array(lowest) - T_world_camera[:3, 3]) / rays
            b = (np.array(highest) - T_world_camera[:3, 3]) / rays
            enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            hit = (enter <= leave) & (enter > 0.01) & (enter < depth)
            depth[hit], labels[hit] = enter[hit], ids[name]
    seen = np.isfinite(depth)
    return CameraImage(
        camera,
        np.zeros((size, size, 3), np.uint8),
        np.where(seen, depth, 0).astype(np.float32),
        labels.astype(np.int32),
        names,
        K,
        T_world_camera,
    )


def head(boxes: list[Box]) -> CameraImage:
    """A head camera 1.3 m above the floor, 0.7 m before the origin, looking down at (0, 0, 0.3)."""
    tilt = np.arctan2(1.0, 0.7)
    return picture("head", transform(rot_y(tilt) @ LINK_TO_OPTICAL, (-0.7, 0.0, 1.3)), boxes)


def wrist(boxes: list[Box], side: Side = "right") -> CameraImage:
    """A wrist camera of a hand at the world's origin, fingers along z."""
    T = transform(rot_y(-np.pi / 2 + r1.WRIST_CAMERA_TILT_RAD) @ LINK_TO_OPTICAL, r1.WRIST_CAMERA_M)
    return picture(side, T, boxes, 224, 1.4)


def fingers(width_m: float) -> list[Box]:
    """Two fingers that far apart, and the palm."""
    h = width_m / 2
    return [
        ("robot", (-0.011, h, 0.103), (0.011, h + 0.012, 0.158)),
        ("robot", (-0.011, -h - 0.012, 0.103), (0.011, -h, 0.158)),
        ("robot", (-0.03, -0.1, 0.03), (0.03, 0.1, 0.10)),
    ]


FLOOR: Box = ("floor", (-3, -3, -0.1), (3, 3, 0.0))


def trash_can(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> list[Box]:
    """An open box, 24 cm wide and 30 cm high, with walls of 1 cm."""
    w, t, h = 0.12, 0.01, 0.30
    return [
        ("bin", (x - w, y - w, z), (x + w, y + w, z + t)),
        ("bin", (x - w, y - w, z), (x - w + t, y + w, z + h)),
        ("bin", (x + w - t, y - w, z), (x + w, y + w, z + h)),
        ("bin", (x - w, y - w, z), (x + w, y - w + t, z + h)),
        ("bin", (x - w, y + w - t, z), (x + w, y + w, z + h)),
    ]


def can(x: float, y: float, z: float, name: str = "can_1") -> Box:
    """A can that stands on height `z`."""
    return (name, (x - 0.033, y - 0.033, z), (x + 0.033, y + 0.033, z + 0.12))


def see(criterion: str, image: CameraImage) -> Judgement:
    """The visual judge's answer."""
    return VisualChecker(PHRASES).check(criterion, image)


# ------------------------------------------------------------------------------------------------- language


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("the trash can is held in a gripper", Criterion("held", "trash can")),
        ("The object is held in the robot's gripper.", Criterion("held", "object")),
        ("the cup is held in the robot's left gripper", Criterion("held", "cup", side="left")),
        ("The robot is holding the cup in its right hand", Criterion("held", "cup", side="right")),
        ("the cup is in the left hand", Criterion("held", "cup", side="left")),
        ("a can of soda is in the trash can", Criterion("inside", "can of soda", "trash can")),
        ("there are two soda cans inside the trash can", Criterion("inside", "soda cans", "trash can", 2)),
        ("2 cans of soda are in the trash can", Criterion("inside", "cans of soda", "trash can", 2)),
        ("the cup is on top of the kitchen table", Criterion("ontop", "cup", "kitchen table")),
        ("both books are on the shelf", Criterion("ontop", "books", "shelf", 2)),
        ("the shoes are next to the sofa", Criterion("nextto", "shoes", "sofa")),
        ("the shoes are on the floor beside the sofa", Criterion("nextto", "shoes", "sofa")),
        ("the cup is in front of the tv", Criterion("nextto", "cup", "tv")),
        ("there are two shoes next to the sofa", Criterion("nextto", "shoes", "sofa", 2)),
        ("the ball is lying underneath the table", Criterion("under", "ball", "table")),
        ("the door of the fridge is open", Criterion("open", "door of the fridge")),
        ("the drawer is now fully closed", Criterion("closed", "drawer")),
        ("the radio is turned on", Criterion("on", "radio")),
        ("the lamp is off", Criterion("off", "lamp")),
        ("the box is held with both hands", Criterion("lifted", "box")),
        ("the robot is holding the box in both hands", Criterion("lifted", "box")),
        ("the box is lifted off the floor", Criterion("lifted", "box")),
        ("the table is wiped clean", Criterion("clean", "table")),
        ("the plant is sprayed", Criterion("sprayed", "plant")),
        ("the can is not in the bin", None),
        ("the robot is happy", None),
        ("", None),
        ("the can is in " + "a" * MOST_CHARACTERS, None),
    ],
)
def test_a_sentence_states_its_criterion(text: str, expected: Criterion | None) -> None:
    """Plain sentences of the known relations are understood; others are not, and say nothing."""
    assert parse(text) == expected


@settings(max_examples=50, deadline=None)
@given(st.text(max_size=200))
def test_any_text_is_parsed_without_an_error(text: str) -> None:
    """Criteria come from language models: nothing that they write breaks the judge."""
    parsed = parse(text)
    assert parsed is None or parsed.count >= 1
    assert not OracleChecker(Facts(), PHRASES).check(text, None).complete or parsed is not None


def test_a_phrase_means_each_thing_called_so_in_singular_or_plural() -> None:
    """Soda cans are cans of soda."""
    assert named("soda cans", PHRASES) == ["can_1", "can_2"]
    assert named("a can of soda", PHRASES) == ["can_1", "can_2"]
    assert named("door of the cabinet", PHRASES) == named("cabinet doors", PHRASES) == ["cabinet"]
    assert named("front door", {"gate": ("front door",)}) == ["gate"]
    assert named("bin", PHRASES) == ["bin"]
    assert named("bottle", PHRASES) == []


# ------------------------------------------------------------------------------------------------------- in


def test_a_can_in_the_bin_is_in_it() -> None:
    """Standing on the bin's floor, seen over its rim."""
    assert see("a can of soda is in the trash can", head([FLOOR, *trash_can(), can(0.05, 0.0, 0.01)])).complete


@pytest.mark.parametrize("where", [(-0.17, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, -0.17, 0.0), (0.3, 0.0, 0.0)])
def test_a_can_beside_the_bin_is_not_in_it(where: tuple[float, float, float]) -> None:
    """Before, left, right and behind."""
    assert not see("a can of soda is in the trash can", head([FLOOR, *trash_can(), can(*where)])).complete


def test_a_can_held_above_the_bin_is_not_in_it() -> None:
    """Within its outline, but over the rim."""
    judged = see("a can of soda is in the trash can", head([FLOOR, *trash_can(), can(0.0, 0.0, 0.36)]))
    assert not judged.complete
    assert "above" in judged.reason


def gripper(x: float, y: float, z: float) -> list[Box]:
    """Two fingers about a can that stands at a place."""
    return [
        ("robot", (x - 0.03, y + 0.033, z), (x + 0.03, y + 0.06, z + 0.15)),
        ("robot", (x - 0.03, y - 0.06, z), (x + 0.03, y - 0.033, z + 0.15)),
    ]


def test_a_can_that_a_hand_holds_in_a_cabinet_is_not_in_it_yet() -> None:
    """Between fingers, over a board and under a roof; let go of and standing there, it is."""
    walls: list[Box] = [
        ("cabinet", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4)),
        ("cabinet", (0.38, -0.4, 0.4), (0.4, 0.4, 0.8)),
    ]
    held = head([FLOOR, *walls, can(0.0, 0.0, 0.55), *gripper(0.0, 0.0, 0.55)])
    judged = see("a can of soda is in the cabinet", held)
    assert not judged.complete
    assert "gripper" in judged.reason
    assert see("a can of soda is in the cabinet", head([FLOOR, *walls, can(0.0, 0.0, 0.4)])).complete


def test_what_a_hand_still_holds_on_a_table_is_not_on_it_yet() -> None:
    """It may come along, or be set down elsewhere."""
    table: Box = ("table", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4))
    held = see("a can of soda is on the table", head([FLOOR, table, can(0.0, 0.0, 0.41), *gripper(0.0, 0.0, 0.41)]))
    assert not held.complete
    assert "gripper" in held.reason
    assert see("a can of soda is on the table", head([FLOOR, table, can(0.0, 0.0, 0.4)])).complete


@pytest.mark.parametrize(("before_m", "done"), [(0.08, False), (0.3, True)])
def test_what_a_hand_covers_may_still_be_held(before_m: float, done: bool) -> None:
    """Seen past its palm, a hand that has set a can down looks as if it had let go; an arm far before it hides less."""
    table: Box = ("table", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4))
    x, z = np.array([0.0, 0.52]) + before_m * np.array([-0.67, 0.75])  # toward the camera from the can's top
    palm: Box = ("robot", (x - 0.05, -0.07, z - 0.003 / before_m), (x, 0.07, z + 0.08))
    shown = head([FLOOR, table, can(0.0, 0.0, 0.4), palm])
    assert see("a can of soda is on the table", shown).complete == done


def test_what_lies_next_to_a_thing_in_a_hand_is_next_to_nothing_yet() -> None:
    """A can on a table and another one that a gripper is about to put there; once it stands there, both are."""
    table: Box = ("table", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4))
    held = head([FLOOR, table, can(0.08, 0.0, 0.4), can(0.0, 0.0, 0.45, "can_2"), *gripper(0.0, 0.0, 0.45)])
    assert not see("a can of soda is next to another can of soda", held).complete
    air = head([FLOOR, table, can(0.08, 0.0, 0.4), can(0.0, 0.0, 0.5, "can_2")])
    assert not see("a can of soda is next to another can of soda", air).complete
    both = head([FLOOR, table, can(0.0, -0.08, 0.4), can(0.0, 0.0, 0.4, "can_2")])
    assert see("a can of soda is next to another can of soda", both).complete


@pytest.mark.parametrize(("shown", "done"), [(True, False), (False, True)])
def test_what_an_arm_is_seen_across_may_still_be_held(shown: bool, done: bool) -> None:
    """The hand on the second sandal was hidden by its own forearm, and swept it away again."""
    other: Box = ("can_1", (-0.1, 0.012, 0.0), (0.2, 0.09, 0.03))
    crossed: Box = ("can_2", (-0.1, -0.09, 0.0), (0.2, 0.0, 0.03))
    arm: Box = ("robot", (-0.24, -0.3, 0.5), (-0.21, 0.005, 0.53))
    boxes = [FLOOR, other, crossed, *([arm] if shown else [])]
    assert see("a can of soda is next to another can of soda", head(boxes)).complete is done


def test_a_bin_in_the_air_holds_its_can_too() -> None:
    """The container may be carried: its own rim counts, not its height."""
    image = head([FLOOR, *trash_can(z=0.3), can(0.04, 0.0, 0.31)])
    assert see("a can of soda is in the trash can", image).complete


def test_counts_are_at_least_so_many() -> None:
    """One can is not two; two are two and one."""
    one = head([FLOOR, *trash_can(), can(0.05, 0.05, 0.01), can(0.5, 0.3, 0.0, "can_2")])
    two = head([FLOOR, *trash_can(), can(0.05, 0.05, 0.01), can(0.05, -0.05, 0.01, "can_2")])
    assert not see("two cans of soda are in the trash can", one).complete
    assert see("two cans of soda are in the trash can", two).complete
    assert see("one can of soda is in the trash can", two).complete


# ------------------------------------------------------------------------------------------------------- on


def test_a_can_on_the_table_is_on_it_and_not_on_the_floor() -> None:
    """It rests on what is right under it."""
    image = head([FLOOR, ("table", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4)), can(0.0, 0.0, 0.4)])
    assert see("the can of soda is on the table", image).complete
    assert not see("the can of soda is on the floor", image).complete


def test_a_can_above_the_table_is_not_on_it() -> None:
    """Nor is one that is held 10 cm over it."""
    image = head([FLOOR, ("table", (-0.3, -0.4, 0.38), (0.4, 0.4, 0.4)), can(0.0, 0.0, 0.5)])
    assert not see("the can of soda is on the table", image).complete


def test_a_can_on_the_floor_beside_a_cabinet_is_not_on_it() -> None:
    """A vertical face that ends at the can's height is no support."""
    image = head([FLOOR, ("cabinet", (0.1, -0.5, 0.0), (0.5, 0.5, 0.8)), can(0.04, 0.0, 0.0)])
    assert not see("the can of soda is on the cabinet", image).complete
    assert see("the can of soda is on the floor", image).complete


# ----------------------------------------------------------------------------------------------------- held


@settings(max_examples=10, deadline=None)
@given(st.floats(0.012, 0.088))
def test_what_is_between_the_fingertips_is_held(width_m: float) -> None:
    """Of any width that a hand can grasp, in the picture of that hand's camera."""
    h = width_m / 2
    image = wrist(
        [*fingers(width_m), ("can_1", (-0.03, -h, 0.13), (0.03, h, 0.25)), ("floor", (-2, -2, 0.4), (2, 2, 1))]
    )
    assert see("the can of soda is held in a gripper", image).complete
    assert see("the can of soda is held in the right gripper", image).complete
    assert not see("the can of soda is held in the left gripper", image).complete


def test_what_lies_beyond_or_beside_the_fingers_is_not_held() -> None:
    """Far below an open hand, and next to a closed one."""
    below = wrist([*fingers(0.1), ("can_1", (-0.03, -0.03, 0.24), (0.03, 0.03, 0.36))])
    beside = wrist([*fingers(0.0), ("can_1", (-0.03, 0.014, 0.13), (0.03, 0.08, 0.25))])
    assert not see("the can of soda is held in a gripper", below).complete
    assert not see("the can of soda is held in a gripper", beside).complete


def test_the_head_sees_a_can_lifted_by_the_robot_but_not_one_that_it_touches_on_the_floor() -> None:
    """Touching is not holding; lifted off everything is."""
    hand: list[Box] = [
        ("robot", (-0.03, 0.033, 0.45), (0.03, 0.06, 0.6)),
        ("robot", (-0.03, -0.06, 0.45), (0.03, -0.033, 0.6)),
    ]
    touch: list[Box] = [
        ("robot", (-0.03, 0.033, 0.0), (0.03, 0.06, 0.2)),
        ("robot", (-0.03, -0.06, 0.0), (0.03, -0.033, 0.2)),
    ]
    assert see("the can of soda is held in a gripper", head([FLOOR, *hand, can(0.0, 0.0, 0.45)])).complete
    assert not see("the can of soda is held in a gripper", head([FLOOR, *touch, can(0.0, 0.0, 0.0)])).complete
    assert not see("the can of soda is held in a gripper", head([FLOOR, can(0.0, 0.0, 0.45)])).complete


@pytest.mark.parametrize(
    ("z", "sides", "off", "held"),
    [
        (0.4, (-1, 1), 0.03, True),
        (0.4, (-1, 1), 0.1, False),
        (0.0, (-1, 1), 0.03, False),
        (0.4, (1,), 0.03, False),
        (0.4, (), 0.0, False),
    ],
)
def test_the_head_sees_what_two_hands_press_below_its_lid(
    z: float, sides: tuple[int, ...], off: float, held: bool
) -> None:
    """The lid hides where they touch it; with one hand, hands farther off, or on the floor, a thing is not held."""
    body: list[Box] = [
        ("bin", (-0.15, -0.15, z), (0.15, 0.15, z + 0.2)),
        ("bin", (-0.155, -0.16, z + 0.2), (0.155, 0.16, z + 0.22)),
    ]
    for y in [s * (0.155 + off) for s in sides]:
        body.append(("robot", (-0.04, y - 0.03, z + 0.08), (0.04, y + 0.03, z + 0.15)))
    judged = see("the trash can is held with both hands", head([FLOOR, *body]))
    assert judged.complete is held


# ----------------------------------------------------------------------------------------------- the robot's place


@pytest.mark.parametrize(("x", "near"), [(0.3, True), (-0.2, True), (0.8, False)])
def test_the_robot_is_at_what_it_sees_within_reach(x: float, near: bool) -> None:
    """As far as the camera, 0.7 m before the origin, is from it on the floor; by any of the words that mean it."""
    for said in ("the robot is at the trash can", "the robot is next to the other trash can"):
        judged = see(said, head([FLOOR, *trash_can(x)]))
        assert judged.complete is near, judged.reason


def test_the_robot_is_not_at_what_it_carries_or_does_not_see() -> None:
    """A can in the bin that it holds is no can that it has come to; a second one there is."""
    hand: list[Box] = [("robot", (-0.03, 0.12, 0.35), (0.03, 0.15, 0.5))]
    carried = [FLOOR, *hand, *trash_can(z=0.2), can(0.0, 0.0, 0.3)]
    assert "carried" in see("the robot is at a can of soda", head(carried)).reason
    assert not see("the robot is at the table", head(carried)).complete
    assert see("the robot is at a can of soda", head([*carried, can(0.2, -0.3, 0.0, "can_2")])).complete
    assert not see("the robot is at the trash can", wrist([*trash_can()])).complete


# --------------------------------------------------------------------------------------------------- doubts


def test_what_was_seen_in_place_counts_until_it_is_seen_elsewhere() -> None:
    """Cans in two bins that no one picture shows are two; not where the first was taken out, or none is seen now."""
    two, asked = {**PHRASES, "bin_2": ("trash can",)}, "two cans of soda are in trash cans"
    first = head([FLOOR, *trash_can(), can(0.0, 0.0, 0.01)])
    other_bin = [("bin_2", low, high) for _, low, high in trash_can()]
    second = head([FLOOR, *other_bin, can(0.0, 0.0, 0.01, "can_2")])
    taken_out, nothing = head([FLOOR, can(0.2, 0.2, 0.0)]), head([FLOOR, *other_bin])

    def said(*pictures: CameraImage) -> Judgement:
        checker = VisualChecker(two)
        return [checker.check(asked, image) for image in pictures][-1]

    assert said(first, second).complete
    assert "1 before" in said(first, second).reason
    for pictures in ([second], [first, first], [first, taken_out, second], [first, nothing]):
        assert not said(*pictures).complete


def test_what_was_seen_beside_a_thing_counts_as_well() -> None:
    """Of two cans next to a bin the near one hides the other in the second picture."""
    asked, checker = "two cans of soda are next to the trash can", VisualChecker(PHRASES)
    near, far = can(-0.16, 0.0, 0.0), can(0.0, 0.16, 0.0, "can_2")
    assert not checker.check(asked, head([FLOOR, *trash_can(), far])).complete
    assert checker.check(asked, head([FLOOR, *trash_can(), near])).complete


def test_what_it_cannot_see_or_parse_is_a_no_with_a_reason() -> None:
    """No picture, no labels, thing not in view, thing unknown, sentence not understood."""
    checker, empty = VisualChecker(PHRASES), head([FLOOR])
    blind = CameraImage("head", empty.rgb, empty.depth, None, {}, empty.K, empty.T_world_camera)
    for criterion, image in [
        ("a can of soda is in the trash can", None),
        ("a can of soda is in the trash can", blind),
        ("a can of soda is in the trash can", empty),
        ("a unicorn is in the trash can", empty),
        ("all is well", empty),
    ]:
        judged = checker.check(criterion, image)
        assert not judged.complete
        assert judged.reason


def test_a_scene_elsewhere_in_the_world_is_judged_the_same() -> None:
    """Judgements do not depend on where the scene lies in the world."""
    T = transform(rot_y(np.arctan2(1.0, 0.7)) @ LINK_TO_OPTICAL, (9.3, -4.0, 1.3))
    boxes: list[Box] = [FLOOR, *trash_can(), can(0.05, 0.0, 0.01)]
    moved: list[Box] = [(n, (a[0] + 10, a[1] - 4, a[2]), (b[0] + 10, b[1] - 4, b[2])) for n, a, b in boxes]
    assert see("a can of soda is in the trash can", picture("head", T, moved)).complete


def test_both_judges_keep_the_contract_of_a_checker() -> None:
    """The same checks as every checker, ours or a user's."""
    check_checker(VisualChecker(PHRASES))
    check_checker(OracleChecker(Facts(), PHRASES))


def test_a_can_beside_the_bin_is_next_to_it_and_one_in_it_or_far_away_is_not() -> None:
    """By the gap between them, seen from above."""
    beside, inside, away = can(0.0, 0.18, 0.0), can(0.0, 0.0, 0.02), can(0.0, 0.6, 0.0)
    for box, so in ((beside, True), (inside, False), (away, False)):
        judged = see("the can of soda is next to the trash can", head([FLOOR, *trash_can(), box]))
        assert judged.complete is so, judged.reason


def test_a_can_is_next_to_what_is_tall_at_a_larger_gap() -> None:
    """As BEHAVIOR has it, the gap may be a sixth of both sizes, over all three axes: trees are thin and high."""
    for height_m, so in ((1.0, True), (0.2, False)):
        post: Box = ("bin", (0.0, -0.1, 0.0), (0.1, 0.1, height_m))
        judged = see("the can of soda is next to the trash can", head([FLOOR, post, can(-0.088, 0.0, 0.0)]))
        assert judged.complete is so, judged.reason


def test_a_can_in_the_empty_corner_of_the_box_around_a_thing_is_next_to_it() -> None:
    """Two walls at a right angle leave most of the box around them free; what is held over or put on them is not so."""
    walls: list[Box] = [("bin", (0.15, -0.2, 0.0), (0.2, 0.2, 0.3)), ("bin", (-0.1, 0.15, 0.0), (0.2, 0.2, 0.3))]
    for box, so in ((can(0.05, 0.05, 0.0), True), (can(0.175, 0.0, 0.3), False)):
        judged = see("the can of soda is next to the trash can", head([FLOOR, *walls, box]))
        assert judged.complete is so, judged.reason


def test_a_can_under_the_table_is_under_it_and_one_on_it_beside_it_or_in_a_bin_is_not() -> None:
    """A part of the table must be seen over it."""
    top: Box = ("table", (-0.1, -0.4, 0.60), (0.7, 0.4, 0.64))
    for box, so in ((can(0.0, 0.0, 0.0), True), (can(0.2, 0.0, 0.64), False), (can(-0.25, 0.0, 0.0), False)):
        judged = see("the can of soda is under the table", head([FLOOR, top, box]))
        assert judged.complete is so, judged.reason
    in_bin = see("the can of soda is under the trash can", head([FLOOR, *trash_can(), can(0.0, 0.0, 0.02)]))
    assert not in_bin.complete


def cabinet(door: str) -> list[Box]:
    """A hollow cabinet, 60 x 50 x 70 cm, whose front, toward the camera, is closed, open or gone out as a drawer."""
    t, x, w, d, h = 0.02, -0.1, 0.3, 0.5, 0.7
    walls: list[Box] = [
        ("cabinet", (x, -w, 0), (x + d, -w + t, h)),
        ("cabinet", (x, w - t, 0), (x + d, w, h)),
        ("cabinet", (x, -w, 0), (x + d, w, t)),
        ("cabinet", (x, -w, h - t), (x + d, w, h)),
        ("cabinet", (x + d - t, -w, 0), (x + d, w, h)),
    ]
    handle: Box = ("cabinet", (x - t - 0.05, 0.2, 0.3), (x - t - 0.03, 0.22, 0.5))
    if door == "closed":
        return [*walls, ("cabinet", (x - t, -w, 0), (x, w, h)), handle]
    if door == "open":
        return [*walls, ("cabinet", (x - 0.5, -w - t, 0), (x, -w, h))]
    drawer: list[Box] = [
        ("cabinet", (x - 0.25 - t, -w, 0.3), (x - 0.25, w, h)),
        ("cabinet", (x - 0.25, -w, 0.3), (x, w, 0.32)),
    ]
    return [*walls, *drawer, ("cabinet", (x - t, -w, 0), (x, w, 0.3))]


@pytest.mark.parametrize("door", ["closed", "open", "drawer"])
def test_an_open_cabinet_is_told_from_a_closed_one(door: str) -> None:
    """One sees into the one; the handle of the other does not count."""
    for word, so in (("open", door != "closed"), ("closed", door == "closed")):
        judged = see(f"the cabinet is {word}", head(cabinet(door)))
        assert judged.complete is so, judged.reason


@pytest.mark.parametrize("aside", [1.0, 1.1])
def test_what_little_the_edge_of_the_picture_leaves_of_a_cabinet_does_not_tell(aside: float) -> None:
    """All that is seen of one that stands wide open is its side, or its door: flat, and far from closed."""
    boxes: list[Box] = [
        (name, (low[0], low[1] + aside, low[2]), (high[0], high[1] + aside, high[2]))
        for name, low, high in cabinet("open")
    ]
    judged = see("the cabinet is closed", head(boxes))
    assert not judged.complete
    assert "does not tell" in judged.reason


@pytest.mark.parametrize("door", ["closed", "open"])
def test_a_cabinet_is_not_closed_because_another_is(door: str) -> None:
    """Of two that are seen, both have to be."""
    beside: list[Box] = [
        ("other", (low[0] + 0.3, low[1] + 0.65, low[2]), (high[0] + 0.3, high[1] + 0.65, high[2]))
        for _, low, high in cabinet("closed")
    ]
    checker = VisualChecker({"cabinet": ("cabinet",), "other": ("cabinet",)})
    judged = checker.check("the cabinet is closed", head([*beside, *cabinet(door)]))
    assert judged.complete is (door == "closed"), judged.reason


@pytest.mark.parametrize(("color", "on"), [((30, 240, 80), True), ((220, 30, 25), False)])
def test_the_light_of_a_switch_tells_what_is_on(color: tuple[int, int, int], on: bool) -> None:
    """Green is on and red is off; where no light is seen, neither is so."""
    light: Box = ("cabinet.switch", (-0.16, 0.0, 0.5), (-0.15, 0.03, 0.53))
    image = head([*cabinet("closed"), light])
    assert image.labels is not None
    number = next(i for i, name in image.names.items() if name == light[0])
    image.rgb[image.labels == number] = color
    assert see("the cabinet is turned on", image).complete is on
    assert see("the cabinet is switched off", image).complete is not on
    for word in ("on", "off"):
        assert not see(f"the cabinet is {word}", head(cabinet("closed"))).complete


@pytest.mark.parametrize("state", ["clean", "sprayed"])
def test_what_no_picture_tells_is_a_no(state: str) -> None:
    """With that as the reason."""
    judged = see(f"the cabinet is {state}", head(cabinet("closed")))
    assert not judged.complete
    assert "no picture tells" in judged.reason


def test_what_the_skills_should_end_in_is_understood() -> None:
    """Every sentence that a skill's file has for the judge is a criterion, with the words in their places."""
    for skill in load_skills().values():
        if skill.shows:
            words = {"object": "cup", "container": "sink", "surface": "sofa", "target": "lamp", "to_hand": "left"}
            asked = parse(filled(skill.shows, words | {"state": "on", "tool": "mop"}) or "")
            assert asked is not None, skill.shows
            assert asked.subject in words.values()


# --------------------------------------------------------------------------------------------------- oracle


class Facts:
    """One can held in the left hand by the table, the other in the bin, the bin on the floor, the cabinet open."""

    def held(self, name: str, side: Side | None) -> bool:
        """Whether it is so."""
        return name == "can_1" and side in (None, "left")

    def lifted(self, name: str) -> bool:
        """Whether it is so."""
        return name == "can_1"

    def at(self, phrase: str) -> bool | None:
        """Whether it is so; nothing else is called anything."""
        return {"trash can": True, "cabinet": False}.get(phrase)

    def so(self, relation: Relation, name: str, other: str) -> bool | None:
        """Whether it is so; nothing is known of dirt."""
        facts = {
            ("inside", "can_1", "bin"),
            ("inside", "can_2", "bin"),
            ("ontop", "bin", "floor"),
            ("open", "cabinet", ""),
            ("nextto", "bin", "table"),
            ("nextto", "can_1", "table"),
            ("nextto", "can_2", "can_1"),
        }
        return None if relation == "clean" else (relation, name, other) in facts


@pytest.mark.parametrize(
    ("criterion", "so"),
    [
        ("the robot is at the trash can", True),
        ("the robot is in front of the cabinet", False),
        ("the robot is at the moon", False),
        ("a can of soda is held in a gripper", True),
        ("a can of soda is held in the left gripper", True),
        ("a can of soda is held in the right gripper", False),
        ("the trash can is held in a gripper", False),
        ("one can of soda is in the trash can", True),
        ("two cans of soda are in the trash can", False),
        ("the trash can is on the floor", True),
        ("the trash can is on the table", False),
        ("the trash can is next to the table", True),
        ("the trash can is under the table", False),
        ("a can of soda is next to the table", False),
        ("a can of soda is next to another can of soda", False),
        ("the cabinet is open", True),
        ("the door of the cabinet is open", True),
        ("the cabinet is closed", False),
        ("the table is clean", False),
        ("a can of soda is held with both hands", True),
        ("a unicorn is on the table", False),
        ("all is well", False),
    ],
)
def test_the_oracle_says_what_is_so(criterion: str, so: bool) -> None:
    """Whatever is true, by name, hand and count; a thing in hand is not set down; what does not parse is a no."""
    assert OracleChecker(Facts(), PHRASES).check(criterion, None).complete is so


def test_of_several_alike_none_may_stand_open_where_one_is_to_be_closed() -> None:
    """A cabinet that nobody touched is closed all the time: that does not shut the one next to it."""

    class Cabinets(Facts):
        def so(self, relation: Relation, name: str, other: str) -> bool | None:
            return (relation == "open") == (name in self.ajar)

        ajar: frozenset[str] = frozenset()

    truth = Cabinets()
    oracle = OracleChecker(truth, {"cabinet_1": ("cabinet",), "cabinet_2": ("cabinet",)})
    assert oracle.check("the cabinet is closed", None).complete
    truth.ajar = frozenset({"cabinet_2"})
    assert not oracle.check("the cabinet is closed", None).complete
    assert oracle.check("the cabinet is open", None).complete


# ------------------------------------------------------------------------------------------------- mistakes


class Steps:
    """A clock that is moved by hand."""

    steps, time_s = 0, 0.0


def mistaken(answer: bool, address: str, seed: int = 0) -> tuple[MistakenChecker, Steps]:
    """A checker that always gives one answer, with errors, and its clock."""
    clock = Steps()
    checker = ScriptedChecker({"c": (answer,), "d": (answer,)}, needs_image=False)
    return MistakenChecker(checker, CheckErrors.read(address, "checker scripted"), clock, seed), clock


def answers(checker: Checker, clock: Steps, criterion: str = "c", n: int = 4000) -> list[bool]:
    """What it says at each of so many steps."""
    said = []
    for clock.steps in range(n):
        said.append(checker.check(criterion, None).complete)
    return said


@pytest.mark.parametrize(("answer", "name", "rate"), [(False, "fp", 0.05), (True, "fn", 0.1), (False, "fp", 1.0)])
def test_a_checker_errs_at_the_rate_that_it_is_told(answer: bool, name: str, rate: float) -> None:
    """On any question: none is safe from a false yes. The other kind of mistake is another's."""
    said = answers(*mistaken(answer, f"{name}={rate}"))
    wrong = np.mean([a is not answer for a in said])
    assert abs(wrong - rate) < 4 * np.sqrt(rate * (1 - rate) / len(said)) + 1e-9
    other = "fn" if name == "fp" else "fp"
    assert answers(*mistaken(answer, f"{other}=1"), n=50) == [answer] * 50


def test_mistakes_follow_from_seed_criterion_and_step() -> None:
    """The same run has the same ones, asked twice too; another seed or another criterion has others."""
    first = answers(*mistaken(False, "fp=0.3"))
    assert answers(*mistaken(False, "fp=0.3")) == first
    assert answers(*mistaken(False, "fp=0.3", seed=1)) != first
    assert answers(*mistaken(False, "fp=0.3"), criterion="d") != first
    checker, clock = mistaken(False, "fp=0.5")
    clock.steps = 17
    assert len({checker.check("c", None) for _ in range(20)}) == 1


def test_a_latency_is_added_to_every_answer() -> None:
    """In simulated time: nobody waits for it here."""
    checker, _ = mistaken(True, "latency=1.5")
    judged = checker.check("c", None)
    assert (judged.complete, judged.latency_s) == (True, 1.5)
    assert checker.name == "scripted:latency=1.5"


def test_a_mistake_is_told_in_its_reason_and_the_rates_in_a_note() -> None:
    """Whoever reads the trace sees that it was no eyesight that failed."""
    checker, _ = mistaken(False, "fp=1,fn=0.25,latency=2")
    assert checker.check("c", None).reason == "by mistake; as scripted"
    assert "100.0%" in checker.note
    assert "25.0%" in checker.note
    assert "2 s" in checker.note
    assert CheckErrors.read(checker.name.partition(":")[2], "x") == CheckErrors(1.0, 0.25, 2.0)


@pytest.mark.parametrize(
    ("checker", "said"),
    [
        ("visual:", "say where"),
        ("visual:fp", "'fp' is not NAME=SIZE, such as fp=0.05,fn=0.1,latency=1"),
        ("visual:fp=2", "fp is 0 to 1, not 2"),
        ("visual:fp=nan", "fp is 0 to 1, not nan"),
        ("visual:fp=0.1,fp=0.1", "fp is given twice"),
        ("oracle:fb=0.1", "unknown mistake 'fb'. Known: fn, fp, latency"),
        ("oracle:latency=1e9", "latency is 0 to 600"),
        ("visul", "Did you mean 'visual'"),
    ],
)
def test_a_checker_that_cannot_be_is_refused_before_anything_starts(checker: str, said: str) -> None:
    """With what would be valid."""
    with pytest.raises(UserError, match=said):
        check_checker_choice(EpisodeConfig("t", checker=checker))


def test_errors_are_off_unless_asked_for_and_said_when_on() -> None:
    """A run with a checker that errs says so before it begins."""
    assert doubt(EpisodeConfig("t")) == doubt(EpisodeConfig("t", checker="oracle")) == ""
    assert doubt(EpisodeConfig("t", checker="visual:fp=0.1")).startswith("checker visual says yes to 10.0%")
