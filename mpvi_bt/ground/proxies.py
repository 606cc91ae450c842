"""Tells addresses of this machine from others, and finds the proxy for the others."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

# In order. Of websockets as the websockets package asks; of HTTP that of its own scheme, then that of any.
_KINDS = {"ws": ("ws", "socks", "https", "http"), "wss": ("wss", "socks", "https")}


def is_this_machine(url: str) -> bool:
    """Whether a URL is of this machine: by an address of its own, as localhost, or by its own name."""
    host = (urlsplit(url).hostname or "").rstrip(".")
    with contextlib.suppress(ValueError):
        return _is_ours(str(ipaddress.ip_address(host)))
    own = socket.gethostname().lower()
    if host in (own, "localhost") or host.endswith(".localhost"):
        return True
    if host.partition(".")[0] != own.partition(".")[0]:
        return False  # without asking a name server, which may be away
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)
    except OSError:
        return False
    return all(_is_ours(str(address[0])) for *_, address in found)


def _is_ours(address: str) -> bool:
    """Whether an IP address is one of this machine's: only those can be bound to."""
    if ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        return True
    try:
        with socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0))
    except OSError:
        return False
    return True


def proxy_for(url: str) -> str:
    """The URL of the proxy that the environment names for a URL, its password with it; "": it is asked directly."""
    parts = urlsplit(url)
    if is_this_machine(url) or proxy_bypass(parts.netloc.rpartition("@")[2]):
        return ""
    proxies = getproxies()
    kinds = _KINDS.get(parts.scheme, (parts.scheme, "all"))
    proxy = next((proxies[kind] for kind in kinds if proxies.get(kind)), "")
    return proxy if "://" in proxy or not proxy else f"http://{proxy}"


def told(proxy: str) -> str:
    """A proxy as it can be told: without user and password."""
    scheme, mark, rest = proxy.rpartition("://")
    return f"the proxy of the environment, {scheme}{mark}{rest.rpartition('@')[2]}"
