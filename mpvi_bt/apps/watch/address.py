"""The address of a served page: parsed, bound to a free port, and checked for who may connect."""

from __future__ import annotations

import errno
import secrets
import socket
from dataclasses import dataclass, field

from mpvi_bt.ground.errors import UserError

HOST, PORT = "127.0.0.1", 8420  # Our choice: a port without a well-known service
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_TRIES = 100


@dataclass(frozen=True)
class Address:
    """Where to listen, as `PORT` or `HOST:PORT` says.

    Attributes:
        host: 127.0.0.1, or what else was asked for.
        port: 0: `PORT`, or the next free one.
    """

    host: str = HOST
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> Address:
        """From text such as "8420", "0.0.0.0:8420" or "". Raises UserError."""
        host, colon, port = text.rpartition(":")
        if not port.isascii() or not port.isdigit() or int(port) > 65535 or (colon and not host):
            if not text:
                return cls()
            raise UserError(f"{text!r} is no PORT and no HOST:PORT, such as {PORT} or 0.0.0.0:{PORT}")
        return cls(host.strip("[]") or HOST, int(port))

    @property
    def local(self) -> bool:
        """Whether only this machine reaches it."""
        return self.host in _LOOPBACK

    def bound(self) -> Bound:
        """Listen. Raises UserError if the port is in use, naming the next free one."""
        wanted = self.port or PORT
        try:
            listener = _listening(self.host, wanted)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                why = (error.strerror or str(error)).lower()
                raise UserError(f"cannot listen at {self.host}:{wanted}: {why}") from None
            free, listener = self._next(wanted + 1)
            if self.port:
                listener.close()
                raise UserError(f"port {wanted} is in use; the next free one is {free}") from None
        token = "" if self.local else secrets.token_urlsafe(16)
        return Bound(self.host, int(listener.getsockname()[1]), listener, token)

    def _next(self, first: int) -> tuple[int, socket.socket]:
        for port in range(first, min(first + _TRIES, 65536)):
            try:
                return port, _listening(self.host, port)
            except OSError:
                continue
        raise UserError(f"no port from {first - 1} to {first + _TRIES - 1} is free")


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(64)
    except OSError:
        listener.close()
        raise
    return listener


@dataclass(frozen=True)
class Bound:
    """Where it listens.

    Attributes:
        host, port: Where.
        listener: The socket.
        token: What a browser has to know; "": nothing, only this machine can ask.
    """

    host: str
    port: int
    listener: socket.socket
    token: str = field(repr=False)

    @property
    def url(self) -> str:
        """What to open in a browser, with the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/" + (f"?token={self.token}" if self.token else "")
