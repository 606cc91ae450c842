"""XML read with the place of every element and attribute in it, bounded and without entities."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import islice
from xml.parsers import expat

from mpvi_bt.ground.errors import FileProblems, Problem
from mpvi_bt.ground.malformed import described, spellings
from mpvi_bt.ground.yaml_reader import MAX_NODES, MAX_PROBLEMS, place_in

MAX_DEPTH = 256  # as deep as BehaviorTree.CPP reads

_ATTRIBUTE = re.compile(rb"""([^\s=/>"']+)\s*=\s*(?:"[^"]*"|'[^']*')""")


@dataclass
class Element:
    """An element.

    Attributes:
        tag: Its name.
        attributes: By name, in the order of the file.
        place: 1-based (line, column) of its "<".
        places: The same of its attributes.
        children: Elements below.
        comments, texts: Places of what stands between them, texts line by line.
    """

    tag: str
    attributes: dict[str, str]
    place: tuple[int, int]
    places: dict[str, tuple[int, int]]
    children: list[Element] = field(default_factory=list)
    comments: list[tuple[int, int]] = field(default_factory=list)
    texts: list[tuple[int, int]] = field(default_factory=list)


def parse_xml(text: str, name: str) -> Element:
    """The root element of a text that `name` stands for in problems.

    Raises:
        FileProblems: It is not well-formed, declares a DOCTYPE (and with it entities), is nested too deep or too large.
    """
    return _XmlParser(text, name).parse()


class _XmlParser:
    def __init__(self, text: str, name: str) -> None:
        self.name, self.text = name, text
        self.bytes = text.encode()
        self.lines = [0, *(found.end() for found in re.finditer(b"\n", self.bytes))]
        self.open: list[Element] = []
        self.root: Element | None = None
        self.comments: list[tuple[int, int]] = []  # outside of all elements
        self.count = 0
        self.expat = expat.ParserCreate("utf-8")
        self.expat.StartElementHandler = self._start
        self.expat.EndElementHandler = lambda _: self.open.pop()
        self.expat.StartDoctypeDeclHandler = self._doctype
        self.expat.CommentHandler = self._comment
        self.expat.CharacterDataHandler = self._text

    def parse(self) -> Element:
        try:
            self.expat.Parse(self.bytes, True)
        except expat.ExpatError as error:
            raise FileProblems(self._malformed(error)) from None
        assert self.root is not None  # else expat finds no element
        self.root.comments += self.comments
        return self.root

    def _malformed(self, error: expat.ExpatError) -> list[Problem]:
        """All misspelled places; if there are none, why the parser stopped."""
        found = [(place_in(self.text, at), message) for at, message in islice(spellings(self.text), MAX_PROBLEMS)]
        if not found:
            at = len(self.bytes[: max(self.expat.ErrorByteIndex, 0)].decode(errors="replace"))
            opened = [(element.tag, element.place[0]) for element in self.open]
            found = [(place_in(self.text, at), described(error, self.text, at, opened))]
        return [Problem(self.name, *place, "syntax", f"not valid XML: {what}") for place, what in found]

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        at = self.expat.CurrentByteIndex
        self.count += 1
        if self.count > MAX_NODES:
            self._stop(at, "too-large", f"more than {MAX_NODES} elements")
        if len(self.open) > MAX_DEPTH:
            self._stop(at, "too-deep", f"nested more than {MAX_DEPTH} deep")
        element = Element(tag, attributes, self._place(at), self._places(at, len(attributes)))
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def _comment(self, _: str) -> None:
        within = self.open[-1].comments if self.open else self.comments
        within.append(self._place(self.expat.CurrentByteIndex))

    def _text(self, text: str) -> None:
        if text.strip():
            before = len(text[: len(text) - len(text.lstrip())].encode())
            self.open[-1].texts.append(self._place(self.expat.CurrentByteIndex + before))

    def _doctype(self, *_: object) -> None:
        self._stop(self.expat.CurrentByteIndex, "doctype", "a DOCTYPE is not allowed: entities are not read")

    def _places(self, at: int, count: int) -> dict[str, tuple[int, int]]:
        """Of the attributes of the tag that begins at a byte."""
        places: dict[str, tuple[int, int]] = {}
        at = re.compile(rb"<[^\s/>]+").match(self.bytes, at).end()  # type: ignore[union-attr]
        while len(places) < count and (found := _ATTRIBUTE.search(self.bytes, at)):
            places[found[1].decode()] = self._place(found.start())
            at = found.end()
        return places

    def _place(self, at: int) -> tuple[int, int]:
        line = bisect_right(self.lines, at)
        return line, len(self.bytes[self.lines[line - 1] : at].decode(errors="replace")) + 1

    def _stop(self, at: int, code: str, message: str) -> None:
        raise FileProblems([Problem(self.name, *self._place(at), code, message)])
