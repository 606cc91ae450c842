"""Words between a run and the process that serves its page: JSON, a line each, over a pair of sockets."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpvi_bt.apps.watch.address import Bound

DEBUGGING = ("line", "pause", "break")
WORDS = (*DEBUGGING, "reload")  # what a page can say to its run
Tell = Callable[[dict[str, Any]], None]

_ROOM_BYTES = 1 << 21  # so much fits between the two before a write has to wait: more than is ever under way
_END_S = 10.0  # within which visitors are told the end, on a busy machine, too


class Page:
    """A page served by a process of its own, for as long as this one wants.

    So a run shares neither its interpreter nor its event loop with visitors: while nobody watches, all that the page
    costs it is a look at `asked` each tick. The process ends with this one, however that ends.

    Attributes:
        url: What to open.
        process: Which serves it.
        asked: Whether a visitor waits for pictures and the time.
        reloads: Whether a visitor wants the tree's file read again.
        heard: Called, by another thread, with what the page's controls say.
    """

    def __init__(self, bound: Bound, what: Path, says: Sequence[str] = ()) -> None:
        """Start the process.

        Args:
            bound: Where it listens.
            what: Trace, or folder of a suite.
            says: Words that the page can say to the run: of `WORDS`.
        """
        self.url = bound.url
        self.asked = self.reloads = False
        self.heard: Callable[[dict[str, str]], object] = lambda said: None
        self._socket, theirs = socket.socketpair()
        for end in (self._socket, theirs):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM_BYTES)
        begin = {"what": os.fspath(what.absolute()), "port": bound.port, "token": bound.token, "says": list(says)}
        fds = bound.listener.fileno(), theirs.fileno()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mpvi_bt.apps.watch.process", *map(str, fds)],
            pass_fds=fds,
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the run; this ends when the run has
        )
        theirs.close()
        bound.listener.close()
        self._lock = threading.Lock()
        self.send(begin)
        threading.Thread(target=self._hear, daemon=True).start()

    def send(self, words: dict[str, Any]) -> None:
        """Tell the page. A page that does not listen any more is no reason to end a run."""
        with contextlib.suppress(OSError), self._lock:
            self._socket.sendall(json.dumps(words).encode() + b"\n")

    def _hear(self) -> None:
        with contextlib.suppress(OSError, ValueError), self._socket.makefile("rb") as lines:
            for line in lines:
                said = json.loads(line)
                if said.get("want"):
                    self.asked = True
                elif "reload" in said:
                    self.reloads = True
                else:
                    self.heard(said)

    def close(self) -> None:
        """Let the visitors be told the end, and end the process."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._socket.close()
