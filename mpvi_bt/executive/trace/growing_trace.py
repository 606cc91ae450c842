"""Reads a trace while it is written."""

from __future__ import annotations

from pathlib import Path

from mpvi_bt.executive.trace.lines import End, Header, Tick
from mpvi_bt.executive.trace.read import MAX_BYTES, LineReader
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.errors import FileProblems, UserError


class Follow:
    """The lines of a growing trace, each told once.

    A file that becomes shorter, or is another one now, is another run's: `Restarted` is raised.

    Attributes:
        header, tree: Of the first line.
        end: The last line, once it is there.
    """

    def __init__(self, path: Path) -> None:
        """Read the first line.

        Raises:
            UserError: There is no such file, or its first line is not whole yet.
            FileProblems: It is no trace.
        """
        self.path = path
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise UserError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
        self._reader = LineReader(str(path))
        self._inode = path.stat().st_ino
        self._rest = b""
        first = self._file.readline(MAX_BYTES)
        if not first.endswith(b"\n"):
            self._file.close()
            raise UserError(f"{path}: its first line is not whole; is it a trace?")
        self.header: Header
        self.tree: TreeSpec
        self.header, self.tree = self._reader.first(first)
        self.end: End | None = None

    def new(self) -> list[Tick]:
        """The ticks that were written since this was asked last.

        Raises:
            Restarted: The file is another run's now.
            FileProblems: A line is wrong.
        """
        try:
            stat = self.path.stat()
        except OSError:
            raise Restarted(f"{self.path}: the file is gone") from None
        if stat.st_ino != self._inode or stat.st_size < self._file.tell():
            raise Restarted(f"{self.path}: another run is written there now")
        ticks: list[Tick] = []
        while line := self._file.readline(MAX_BYTES):
            self._rest += line
            if not self._rest.endswith(b"\n"):
                break  # the rest of it is still to come
            read = self._reader.next(self._rest)
            self._rest = b""
            if self._reader.problems:
                raise FileProblems(self._reader.problems)
            if isinstance(read, End):
                self.end = read
            elif read is not None:
                ticks.append(read)
        return ticks

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Restarted(UserError):
    """The file that was followed is another run's, or gone."""
