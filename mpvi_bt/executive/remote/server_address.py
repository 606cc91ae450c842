"""Addresses of policy servers: a scheme, a host and a port."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import urlsplit

from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.ground.errors import UserError, shown


def address_of(given: str, schemes: Sequence[str], port: int, path: bool = False) -> str:
    """An address with everything in it, such as "ws://localhost:8000".

    Args:
        given: As a user has it.
        schemes: Those that may be; the first one is meant where none is given.
        port: The one that is meant where none is given.
        path: Whether there may be a path behind it.

    Raises:
        UserError: It is none, or has a name, key or query in it.
    """
    *others, last = [f"{scheme}://HOST:PORT" for scheme in schemes] + ["HOST:PORT"]
    form = f"An address is {', '.join(others)} or {last}."
    try:
        parts = urlsplit(given if "://" in given else f"{schemes[0]}://{given}")
        host, told = parts.hostname, parts.port
        (host or "").encode("idna")
        if told == 0:
            raise ValueError("nobody listens at port 0")
    except ValueError as error:
        raise UserError(f"{shown(given)} is no address of a policy server: {error}. {form}") from None
    if parts.username is not None or parts.query or parts.fragment:
        raise UserError(f"an address has no name, key or query in it. {form} A key is read from {KEY}.")
    if parts.scheme not in schemes or (parts.path and not path) or not host or not given.isprintable() or " " in given:
        raise UserError(f"{shown(given)} is no address of a policy server. {form}")
    host = f"[{host}]" if ":" in host else host
    return f"{parts.scheme}://{host}:{port if told is None else told}{parts.path}"
