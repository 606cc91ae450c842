"""The text of an XML file in the encoding that it declares."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from mpvi_bt.ground.errors import FileProblems, Problem, shown
from mpvi_bt.ground.marked_yaml import read_bytes
from mpvi_bt.ground.yaml_reader import place_in

_MARKS = (  # byte order marks; those of UTF-32 begin as those of UTF-16 do
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_UNMARKED = ((b"<\0?\0", "utf-16-le"), (b"\0<\0?", "utf-16-be"))  # "<?" without a mark
_DECLARED = re.compile(rb"""<\?xml[^>]*?\sencoding\s*=\s*["']([^"'<>]*)["']""")
_WIDE = ("utf-16", "utf-32")


def read_xml(path: str | Path) -> str:
    """The text of an XML file, whatever ends its lines there.

    A byte order mark tells the encoding, else the XML declaration, else it is UTF-8 (XML 1.0, appendix F).

    Raises:
        UserError: There is no such file, or it cannot be read.
        FileProblems: It is too large, or no text in its encoding.
    """
    content = read_bytes(path)
    encoding = next((name for mark, name in (*_MARKS, *_UNMARKED) if content.startswith(mark)), "")
    declared = _DECLARED.match(content)
    if not encoding and declared is not None:
        encoding = _codec(str(path), declared[1].decode("ascii", "replace"))
    try:
        text = content.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        before = content[: error.start].decode(encoding or "utf-8", "replace")
        what = f"not {_shown(encoding)} text ({error.reason}: byte {content[error.start]:#04x})"
        hint = "" if encoding else '; a file in another encoding declares it: <?xml version="1.0" encoding="..."?>'
        raise FileProblems([Problem(str(path), *place_in(before, len(before)), "encoding", what + hint)]) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _codec(path: str, declared: str) -> str:
    """The name of the codec for a declared encoding, whose declaration could be read as ASCII."""
    try:
        info = codecs.lookup(declared)
        "".encode(info.name)  # some codecs, such as "hex", are no encodings of text
    except (LookupError, UnicodeError):
        message = f"the declared encoding {shown(declared)} is unknown; write UTF-8"
        raise FileProblems([Problem(path, 1, 1, "encoding", message)]) from None
    if info.name.startswith(_WIDE):
        message = f"the declared encoding is {declared}, but this text has one byte a character: declare what it is"
        raise FileProblems([Problem(path, 1, 1, "encoding", message)])
    return info.name


def _shown(encoding: str) -> str:
    return (encoding or "utf-8").removesuffix("-sig").upper()
