"""Text in the columns of a terminal: what is safe to print, how wide it is, and how it is cut."""

from __future__ import annotations

_JOINERS = "\u200c\u200d"  # they join letters and emoji; every other invisible character is escaped


def one_line(text: str) -> str:
    """The text on one line, with nothing in it that a terminal would obey: labels and feedback come from models.

    White space becomes single spaces. Control characters, lone surrogates and marks that turn the writing direction
    become escapes of Python's, a backslash and a number.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in _JOINERS else c.encode("unicode_escape").decode() for c in " ".join(text.split())
    )


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
