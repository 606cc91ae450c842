"""The standard output for results alone: what else a process prints, from Python or C, goes to standard error."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO


def keep_stdout() -> TextIO:
    """Let descriptor 1 mean standard error from now on; what is returned, as `sys.stdout`, is the standard output.

    C code and child processes write to descriptor 1. A standard stream that is closed becomes the null device, so that
    no file that is opened later takes its descriptor. A `sys.stdout` that somebody has put elsewhere stays as it is.
    """
    _open_closed()
    own = sys.stdout
    try:
        if own.fileno() != 1:
            return own
    except (OSError, ValueError, AttributeError):  # it is no file
        return own
    own.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    lines = 1 if os.isatty(kept) else -1  # buffered by line
    sys.stdout = os.fdopen(kept, "w", encoding=own.encoding, errors=own.errors, buffering=lines)
    return sys.stdout


@contextlib.contextmanager
def stdout_given_back(kept: TextIO) -> Iterator[None]:
    """Descriptor 1 as it was before `keep_stdout` gave `kept`, for a protocol that keeps it for itself."""
    before, on_1 = sys.stdout, os.dup(1)
    kept.flush()
    os.dup2(kept.fileno(), 1)
    unbuffered = os.fdopen(1, "wb", 0, closefd=False)  # nothing waits until the protocol has given it back
    sys.stdout = io.TextIOWrapper(unbuffered, encoding="utf-8", write_through=True)
    try:
        yield
    finally:
        os.dup2(on_1, 1)
        os.close(on_1)
        sys.stdout = before


def _open_closed() -> None:
    for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(descriptor)
        except OSError:  # the lowest free one is taken
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8", closefd=False))
