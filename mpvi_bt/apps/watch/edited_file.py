"""A text file with several writers: read without waiting, and written only if nobody changed it since."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import write_whole

MOST_BYTES = 2_000_000  # Our choice: a hundred times the longest tree that ships
_LINE = re.compile("[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+\\Z")
_BOM = "\ufeff"


class Unreadable(Exception):
    """A file is no text now; the message says why."""


@dataclass(frozen=True)
class FileText:
    """The content of a file as it was read.

    Attributes:
        content: Its bytes.
        text: As UTF-8, without a byte order mark, its lines ended by line feeds alone.
    """

    content: bytes
    text: str

    @property
    def base(self) -> str:
        """What tells these bytes from others."""
        return hashlib.sha256(self.content).hexdigest()[:16]

    def edited(self, text: str) -> bytes:
        """Another text as bytes: a byte order mark stays, and so do the line ends of lines that stay.

        A new line ends as most of the lines do.
        """
        old = self.content.decode()
        mark = _BOM if old.startswith(_BOM) else ""
        lines = _LINE.findall(old.removeprefix(_BOM))
        ends = [line[len(line.rstrip("\r\n")) :] for line in lines]
        kinds = sorted(set(filter(None, ends)), key=lambda end: -ends.count(end)) or ["\n"]
        wanted = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        new = [kinds[0]] * (len(wanted) - 1) + [""]
        if len(kinds) > 1:
            plain = [line.rstrip("\r\n") for line in lines]
            for before, after, size in SequenceMatcher(None, plain, wanted, autojunk=False).get_matching_blocks():
                for i in range(size):
                    if after + i < len(wanted) - 1:
                        new[after + i] = ends[before + i] or kinds[0]
        return (mark + "".join(line + end for line, end in zip(wanted, new, strict=True))).encode()


def read_file_text(path: Path) -> FileText | None:
    """The file as it is now; None: there is none.

    Raises:
        Unreadable: It is no regular file, such as a pipe, too large, no UTF-8, or may not be read.
    """
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe is opened at once, whether anyone writes to it
        try:
            if not stat.S_ISREG(os.fstat(number).st_mode):
                raise Unreadable("is no regular file")
            with os.fdopen(number, "rb", closefd=False) as file:
                content = file.read(MOST_BYTES + 1)
        finally:
            os.close(number)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise Unreadable((error.strerror or str(error)).lower()) from None
    if len(content) > MOST_BYTES:
        raise Unreadable(f"is larger than {MOST_BYTES / 1e6:g} MB")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Unreadable(f"is no UTF-8 text ({error.reason} at byte {error.start})") from None
    return FileText(content, text.replace("\r\n", "\n").replace("\r", "\n"))


def save_over(path: Path, base: FileText, text: str) -> None:
    """Write a text over a file that still is as it was read, or has gone.

    Raises:
        UserError: It is not: what is there is another program's work, and stays.
        DiskFull, BackendError: As of `write_whole`.
    """
    try:
        now = read_file_text(path)
    except Unreadable as error:
        raise UserError(f"the file {error} now: it was left as it is") from None
    if now is not None and now.content != base.content:
        raise UserError("the file has changed on disk since")
    write_whole(path, base.edited(text))
