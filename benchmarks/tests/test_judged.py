"""Laws of the benchmark that compares checkers with the truth."""

from __future__ import annotations

from typing import Any

from benchmarks.judged import Compared, rows
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.protocol import CameraImage

CRITERION = "a can of soda is in the trash can"


class Saying:
    """A checker, or an oracle, that says one thing."""

    name, needs_image = "saying", True

    def __init__(self, complete: bool) -> None:
        self._complete = complete

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        return Judgement(self._complete, "so it is said")

    def decide(self, criterion: str) -> tuple[bool, str]:
        return self._complete, "so it is"


def test_all_are_asked_and_the_first_is_believed() -> None:
    """What each said is kept beside the truth."""
    compared = Compared({"first": Saying(True), "second": Saying(False)}, Saying(False))  # type: ignore[arg-type]
    assert compared.check(CRITERION, None).complete
    (question,) = compared.questions
    assert question["said"] == {"first": [True, "so it is said"], "second": [False, "so it is said"]}
    assert (compared.name, question["truth"]) == ("first", False)


def test_false_answers_are_counted_out_of_what_they_could_be() -> None:
    """A false yes out of the noes, a false no out of the yeses; what nobody knows counts nowhere."""

    def question(truth: bool | None, said: bool, criterion: str = CRITERION) -> dict[str, Any]:
        return {"criterion": criterion, "camera": "head", "truth": truth, "said": {"mine": [said, ""]}}

    asked = [question(True, True), question(True, False), question(False, True), question(False, False)]
    asked += [question(None, True), question(True, True, "the cup is held in a gripper")]
    table = {row[1]: row for row in rows(asked)}
    assert table["all"] == ["`mine`", "all", 5, 3, 3, (1, 2), (1, 3)]
    assert table["inside"][2:] == [4, 2, 2, (1, 2), (1, 2)]
    assert table["held"][2:] == [1, 1, 1, (0, 0), (0, 1)]
