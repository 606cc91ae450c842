"""Keys and passwords, and their removal from answers, errors, recordings and logs."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from urllib.parse import quote

HIDDEN = "[hidden]"
_SHORTEST = 8  # characters: what is shorter, such as the "none" that a local server wants, is a word, and no secret
_TALKATIVE = ("openai", "httpx2", "httpcore2")


@dataclass(frozen=True)
class Secrets:
    """What must not be told, the longest first. It shows none of it itself."""

    values: tuple[str, ...] = field(repr=False)

    @classmethod
    def of(cls, values: Iterable[str]) -> Secrets:
        """Those of some texts that are long enough to be secrets, and how they look in an address."""
        spelled = {
            spelling for value in values for spelling in (value, quote(value, safe="")) if len(value) >= _SHORTEST
        }
        return cls(tuple(sorted(spelled, key=lambda value: (-len(value), value))))

    def hide(self, text: str) -> str:
        """The text without them, however JSON spells them; what is encoded as a whole (base64, say) is not known."""
        for value in self.values:
            text = text.replace(value, HIDDEN)
        return self._escaped.sub(HIDDEN, text) if self._escaped and "\\" in text else text

    @cached_property
    def _escaped(self) -> re.Pattern[str] | None:
        """Finds them where characters of theirs are escaped; JSON within JSON has up to four backslashes for one."""
        spelled = (
            "".join(rf"(?:\\{{0,4}}{re.escape(c)}|\\{{1,4}}u{ord(c):04x})" for c in value) for value in self.values
        )
        return re.compile("|".join(spelled), re.IGNORECASE) if self.values else None

    def guard_logs(self) -> None:
        """Keep them out of what the SDK and the transport below it log, at whatever level."""
        for name in list(logging.root.manager.loggerDict):
            if name.split(".")[0] in _TALKATIVE and self.values:
                logging.getLogger(name).addFilter(_Filter(self))  # one that is equal is added once


@dataclass(frozen=True)
class _Filter:
    """Hides secrets in records. Each logger needs its own: a parent's filter does not see its records."""

    secrets: Secrets

    def filter(self, record: logging.LogRecord) -> bool:
        """Put the record's text in place, without them."""
        record.msg, record.args = self.secrets.hide(record.getMessage()), ()
        if record.exc_info:
            record.exc_text = self.secrets.hide(logging.Formatter().formatException(record.exc_info))
            record.exc_info = None
        return True
