"""Text in terminal columns: escaping, width and truncation."""

from __future__ import annotations

import unicodedata

WIDTH = 80  # columns that every terminal and mail has; what is not told how wide it may be keeps to them
WIDEST = 120  # our choice: longer lines are hard to read, however wide the terminal is
_JOINERS = "\u200c\u200d"  # they join letters and emoji; every other invisible character is escaped


def harmless(text: str) -> str:
    """The text with nothing in it that a terminal would obey, but for line ends and tabs.

    Control characters (of C1, too), lone surrogates and marks that turn the writing direction become JSON's escapes: so
    JSON stays what it is.
    """
    if text.replace("\n", "").replace("\t", "").isprintable():
        return text
    return "".join(c if c.isprintable() or _is_harmless(c) else escape(c) for c in text)


def one_line(text: str) -> str:
    """The same on one line: labels and feedback come from models. White space becomes single spaces."""
    return text if text.isprintable() else harmless(" ".join(text.split()))


def escape(character: str) -> str:
    """A character as JSON writes it in ASCII, such as a backslash and u001b."""
    units = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[i : i + 4]}" for i in range(0, len(units), 4))


def _is_harmless(character: str) -> bool:
    return character in "\n\t" or character in _JOINERS or unicodedata.category(character) == "Zs"


def columns(text: str) -> int:
    """Columns that printable text takes: two for a Chinese character or an emoji, none for a combining accent."""
    if text.isascii():
        return len(text)
    import wcwidth  # loads tables, which most trees never need

    return wcwidth.width(text, control_codes="ignore")


def cut(text: str, width: int) -> str:
    """The text, its end replaced by "..." if it takes more than `width` columns; no character is cut in half."""
    if columns(text) <= width:
        return text
    if width <= 3:
        return _first(text, max(width, 0))
    return _first(text, width - 3).rstrip() + "..."


def wrapped(text: str, width: int, most: int = 1000) -> list[str]:
    """The text in lines of at most `width` columns (two at least), `most` of them, the last cut if there is more."""
    lines: list[str] = []
    line = ""
    for word in text.split(" "):
        if columns(f"{line} {word}" if line else word) <= width:
            line = f"{line} {word}" if line else word
            continue
        if line:
            lines.append(line)
        while columns(word) > width:
            lines.append(_first(word, width) or word[0])
            word = word[len(lines[-1]) :]
        line = word
    lines.append(line)
    if len(lines) > most:
        lines[most - 1 :] = [cut(" ".join(lines[most - 1 :]), width)]
    return lines


def _first(text: str, width: int) -> str:
    if text.isascii():
        return text[:width]
    import wcwidth

    taken, used = [], 0
    for grapheme in wcwidth.iter_graphemes(text):
        used += columns(grapheme)
        if used > width:
            break
        taken.append(grapheme)
    return "".join(taken)
