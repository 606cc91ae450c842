"""Address and credentials of a language model's endpoint. Keys come from the environment only."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import SplitResult, unquote, urlsplit

from mpvi_bt.executive.language.secrets import Secrets
from mpvi_bt.ground.errors import ModelError, UserError, shown
from mpvi_bt.ground.proxies import is_this_machine

KEY, BASE_URL = "OPENAI_API_KEY", "OPENAI_BASE_URL"  # environment variables, as the SDK's
VENDOR = "https://api.openai.com/v1"
EXPOSED = "warning: plain http to another machine: keys, questions and pictures can be read on the way; use https"
_EXAMPLE = "http://localhost:8000/v1"


@dataclass(frozen=True)
class Endpoint:
    """An address and what is said to be let in.

    Attributes:
        url: Without user and password.
        authorization: Value of the header; None: there is none.
        keyed: Whether it has the key in it.
        secrets: What must not be told.
    """

    url: str
    authorization: str | None = field(repr=False)
    keyed: bool
    secrets: Secrets

    @property
    def exposed(self) -> bool:
        """Whether others on the network can read the requests, the key included."""
        return self.url.startswith("http://") and not is_this_machine(self.url)


def split_address(address: str) -> tuple[str, str]:
    """Model and URL of what stands behind "openai:", such as "llama3:8b@http://localhost:11434/v1"; the URL may be "".

    Models may have an @ in their names; a URL has its scheme.

    Raises:
        UserError: There is no model, or what follows the @ looks like an address and is none. A password is not quoted.
    """
    found = re.fullmatch(r"(?s)(.*?)@([A-Za-z][A-Za-z0-9+.-]*://.*)", address)
    model, url = found.groups() if found else (address, "")
    behind = model.rpartition("@")[2] if "@" in model else ""
    if re.fullmatch(r"(localhost|[\w.-]+:\d+)(/.*)?", behind):
        raise UserError(f"openai: a URL has its scheme: say {model.rpartition('@')[0]}@http://{behind[:80]}.")
    if not model or model != model.strip() or not model.isprintable():
        raise UserError(f"openai: say which model, such as openai:MODEL or openai:MODEL@{_EXAMPLE}.")
    if url:
        parts = _split(url, "the URL of openai:MODEL@URL")
        if "@" in parts.netloc:
            raise UserError(
                f"openai: passwords are not taken from the command line: leave @URL out and set {BASE_URL}."
            )
    return model, url


def find_endpoint(url: str = "", environment: Mapping[str, str] = os.environ) -> Endpoint:
    """The endpoint of a URL, else of OPENAI_BASE_URL, else the vendor's; with OPENAI_API_KEY where it is set.

    Raises:
        UserError: There is no such address.
        ModelError: The vendor's own wants a key, and there is none ("no_key"); or what is set is none ("wrong_key").
    """
    parts = _split(url, "the URL") if url else base_url(environment)
    key = environment.get(KEY, "").strip()
    if not re.fullmatch(r"[\x21-\x7e]*", key):
        raise ModelError("wrong_key", f"{KEY} has blanks, line breaks or letters that no key has.")
    host = parts.hostname or ""
    user, password = unquote(parts.username or ""), unquote(parts.password or "")
    place = parts.netloc.rpartition("@")[2]
    bare = f"{parts.scheme}://{place}{parts.path.rstrip('/')}"
    token = base64.b64encode(f"{user}:{password}".encode()).decode()
    if user or password:
        return Endpoint(bare, f"Basic {token}", False, Secrets.of([key, password or user, token]))
    if key:
        return Endpoint(bare, f"Bearer {key}", True, Secrets.of([key]))
    if host == "openai.com" or host.endswith(".openai.com"):
        raise ModelError("no_key", f"{host} wants a key: set {KEY}, or name another endpoint, MODEL@{_EXAMPLE}.")
    return Endpoint(bare, None, False, Secrets.of([]))


def base_url(environment: Mapping[str, str]) -> SplitResult:
    """The parts of OPENAI_BASE_URL, user and password among them, else of the vendor's. Raises UserError."""
    return _split(environment.get(BASE_URL, "").strip() or VENDOR, BASE_URL)


def _split(url: str, what: str) -> SplitResult:
    """A URL's parts. Raises UserError, quoting nothing that may be secret."""
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises if it is none
    except ValueError:
        parts = urlsplit("")
    if parts.scheme not in ("http", "https") or not parts.hostname or not url.isprintable() or " " in url:
        told = f", not {shown(url)}" if url and not re.search(r"[@?#]", url) else ""
        raise UserError(f"openai: {what} must be like {_EXAMPLE}{told}.")
    if parts.query or parts.fragment:
        raise UserError(f"openai: {what} must be like {_EXAMPLE}, without ? and #.")
    return parts
