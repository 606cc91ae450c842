"""Problems of a text of expressions, as they are found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NoReturn

from mpvi_bt.ground.errors import FileProblems, Problem

Place = tuple[int, int]  # 1-based line and column


class Findings:
    """Problems of a text, each with its place.

    Attributes:
        file: What stands for the text in problems.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self._found: dict[tuple[Place, str], Problem] = {}

    @property
    def problems(self) -> list[Problem]:
        """Those so far, each once: a quantifier's body is read for every thing that it is about."""
        return list(self._found.values())

    def problem(self, place: Place, code: str, message: str, **more: Any) -> None:
        """Note a problem. `more`: further fields of it."""
        self._note(Problem(self.file, *place, code, message, **more))

    def unknown(self, place: Place, kind: str, given: str, known: Iterable[str], whose: str = "") -> None:
        """Note an unknown name of some kind."""
        self._note(Problem.unknown(self.file, place, kind, given, known, whose))

    def stop(self, place: Place, code: str, message: str) -> NoReturn:
        """Note a problem that ends the check. Raises FileProblems with all problems so far."""
        self.problem(place, code, message)
        raise FileProblems(self._errors())

    def check(self) -> None:
        """Raise FileProblems if there is an error."""
        if errors := self._errors():
            raise FileProblems(errors)

    def _errors(self) -> list[Problem]:
        return [problem for problem in self.problems if problem.severity == "error"]

    def _note(self, problem: Problem) -> None:
        self._found[(problem.line, problem.column), problem.message] = problem
