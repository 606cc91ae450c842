"""Writes files whole or not at all, so that neither a full disk nor a kill leaves half of one."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from pathlib import Path

from mpvi_bt.ground.errors import BackendError, DiskFull, MpviError, UserError

FULL = (errno.ENOSPC, errno.EDQUOT)  # codes of a disk that is, or of what a user may take of it
_OF_THE_MACHINE = (errno.EIO, errno.EFBIG)


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write bytes, or text as UTF-8, to a temporary file beside `path`, synced, which then takes its place.

    The file gets the permissions that the umask gives every new file, or keeps those that it has. What is no regular
    file, such as a pipe, is written to as it is.

    Raises:
        UserError: It cannot be written there.
        DiskFull: The disk is full; what was there before is untouched.
        BackendError: The disk is broken; likewise.
    """
    data = content.encode() if isinstance(content, str) else content
    given = Path(path)
    path = given.resolve()  # a link stays one
    try:
        if path.exists() and not path.is_file():
            with path.open("wb") as stream:
                stream.write(data)
            return
        temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
        try:
            with temporary.open("xb") as file:
                if path.exists():
                    temporary.chmod(stat.S_IMODE(path.stat().st_mode))
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # the rename itself
        finally:
            os.close(folder)
    except OSError as error:
        raise unwritable(given, error) from None


def unwritable(what: str | Path, error: OSError) -> MpviError:
    """The exception for a failed write: a user error, unless the disk is full or broken."""
    kind = DiskFull if error.errno in FULL else BackendError if error.errno in _OF_THE_MACHINE else UserError
    return kind(f"{what}: cannot be written: {(error.strerror or str(error)).lower()}")
