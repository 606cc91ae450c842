"""Causes of malformed XML, in place of a parser's "not well-formed", with the right spelling.

Other readers of trees accept some of it, so files contain it: "&&" and "<" in scripts, "--" in comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from xml.parsers import expat

_CONSTRUCT = re.compile(
    r"""<!--(?P<comment>.*?)-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|(?P<tag></?[A-Za-z_](?:[^"'<>]|"[^"]*"|'[^']*')*>)"""
    r"|(?P<text>[^<]+|<(?=[\s=<]))",
    re.DOTALL,
)
_QUOTED = re.compile(r""""[^"]*"|'[^']*'""")
_RAW = re.compile(r"&&|<=?|&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);)(?:\w+;)?")
_NAME = re.compile(r"[\w.:-]*")
_UNQUOTED = re.compile(r"([\w.:-]+)\s*=\s*$")
_ALONE = re.compile(r"\s([\w.:-]+)\s*$")


def spellings(text: str) -> Iterator[tuple[int, str]]:
    """The position and the message of each thing that is spelt otherwise in XML."""
    at = 0
    while (part := _CONSTRUCT.match(text, at)) is not None:  # where none begins, the parser's own words must do
        at = part.end()
        if (comment := part["comment"]) is not None:
            for found in re.finditer("--+|-$", comment):
                yield part.start("comment") + found.start(), "'--' within a comment: write '- -', or leave it out"
        elif part["text"] is not None:
            yield from _raw(part["text"], part.start())
        else:
            for value in _QUOTED.finditer(part["tag"] or ""):
                begin = part.start() + value.start()
                if re.search(r"\n\s*<", value[0]):
                    yield begin, "this quote is not closed: what follows would be its text"
                    return
                yield from _raw(value[0], begin)


def _raw(text: str, start: int) -> Iterator[tuple[int, str]]:
    for found in _RAW.finditer(text):
        mended = found[0].replace("&", "&amp;").replace("<", "&lt;")
        what = f"{found[0]!r:.40} is no entity of XML: write the character itself" if found[0][-1] == ";" else ""
        yield start + found.start(), what or f"a raw {found[0]!r}: write {mended!r}"


def described(error: expat.ExpatError, text: str, at: int, opened: Sequence[tuple[str, int]]) -> str:
    """The problem at the position of the parser's stop.

    Args:
        error: What it says.
        text: Of the file.
        at: Index of the character.
        opened: Tag and line of each element that is not closed yet, the outermost first.
    """
    tag, line = opened[-1] if opened else ("", 0)
    name = _NAME.match(text, at)[0]  # type: ignore[index]
    match expat.ErrorString(error.code):
        case expat.errors.XML_ERROR_TAG_MISMATCH:
            return f"'</{name}>' where '</{tag}>' is due, or a '/' at the end of <{tag}> on line {line}"
        case expat.errors.XML_ERROR_NO_ELEMENTS:
            return f"<{tag}> of line {line} is not closed" if tag else "there is nothing in the file"
        case expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT:
            return "more after the end of the file's one element"
        case expat.errors.XML_ERROR_UNCLOSED_TOKEN:
            return "what begins here is not closed"
        case expat.errors.XML_ERROR_MISPLACED_XML_PI:
            return "'<?xml ...?>' may only be the very first of a file"
        case expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE:
            return f"a second {name!r} in this element"
        case expat.errors.XML_ERROR_SYNTAX:
            return "it begins with no '<'"
        case expat.errors.XML_ERROR_INVALID_TOKEN:
            return _token(text, at)
        case said:
            return said


def _token(text: str, at: int) -> str:
    """Why a character cannot stand within a tag."""
    begin = text.rfind("<", 0, at)
    before = text[begin:at]
    char = text[at : at + 1]
    if not char.isprintable() and not char.isspace():
        return f"U+{ord(char):04X} cannot stand in XML"
    if (quote := re.search("[\"']", _QUOTED.sub(lambda value: " " * len(value[0]), before))) is not None:
        line = text.count("\n", 0, begin + quote.start()) + 1
        return f"{char!r} in a text; is the quote of line {line} closed?"
    if (name := _UNQUOTED.search(before)) is not None:
        return f"the value of {name[1]!r:.40} needs quotes, \" or '"
    if before[-1:] in ("'", '"'):
        return "a space is missing before this"
    if (name := _ALONE.search(before)) is not None:
        return f'{name[1]!r:.40} has no value: write {name[1]:.40}="..."'
    return f"{char!r} cannot stand here"
