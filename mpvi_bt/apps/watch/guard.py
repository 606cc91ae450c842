"""Access control of the server: only its own page may ask, and from other machines only with a token."""

from __future__ import annotations

import hmac
import ipaddress
from urllib.parse import quote, urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mpvi_bt.ground.errors import shown

_COOKIE = "mpvi_token"
_HEADERS = (
    (b"cache-control", b"no-store"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"SAMEORIGIN"),
)
_NOTHING_RUNS = (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'; form-action 'none'")
_ICON = (  # a root and its two children
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><path d="M8 4 4 12M8 4l4 8" stroke="#666"/>'
    '<g fill="#2f7d4f"><circle cx="8" cy="4" r="3"/><circle cx="4" cy="12" r="3"/></g>'
    '<circle cx="12" cy="12" r="3" fill="#3a6fb0"/></svg>'
)


class PageGuard:
    """Lets through what comes from the server's own page.

    A page of another site can make a browser send requests here, but not without saying so: by Origin, or by
    Sec-Fetch-Site. A name that another site has pointed at this machine stands in Host. All three are looked at. A link
    that a person follows from elsewhere is let in.

    Where a token is set, the page's address brings it once, and a cookie from then on; programs send it in their
    address, or as a bearer.
    """

    def __init__(self, app: ASGIApp, token: str = "") -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse with 403."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        if scope["type"] != "http":
            return
        request = HTTPConnection(scope)
        answer: Response | None = None
        if why := self._refusal(request):
            answer = PlainTextResponse(f"{why}\n", 403)
        elif self._token and "token" in request.query_params and "text/html" in request.headers.get("accept", ""):
            here = "/" + quote(scope["path"].lstrip("/\\"))  # "//other" would be another site
            answer = RedirectResponse(here, 303)
            answer.set_cookie(_COOKIE, self._token, httponly=True, samesite="strict", path="/")
        elif scope["path"] == "/favicon.ico":
            answer = Response(_ICON, media_type="image/svg+xml")

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = message.get("headers", [])
                named = any(name.lower() == b"content-security-policy" for name, _ in own)
                message["headers"] = [*own, *_HEADERS, *(() if named else (_NOTHING_RUNS,))]
            await send(message)

        await (answer or self._app)(scope, receive, sending)

    def _refusal(self, request: HTTPConnection) -> str:
        """Why not, or ""."""
        host = request.headers.get("host", "")
        if not self._token and not _loopback(host):
            return (
                f"This page was asked for by the name {shown(host)}. Without a token it answers to localhost and to "
                "loopback addresses alone, at any port, as through `ssh -L`. To reach it by another name, start it "
                "with --serve 0.0.0.0:PORT, which prints an address with a token."
            )
        origin = request.headers.get("origin")
        if origin is not None and origin != f"http://{host}":
            return f"This was asked by the page of another site, {shown(origin)}; the page itself is http://{host}."
        site, method = request.headers.get("sec-fetch-site", "none"), request.scope["method"]
        follows = method in ("GET", "HEAD") and request.headers.get("sec-fetch-mode") == "navigate"
        if site not in ("none", "same-origin") and not follows:
            return f"This was asked by the page of another site (Sec-Fetch-Site: {shown(site)})."
        if self._token:
            bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
            given = request.query_params.get("token") or bearer or request.cookies.get(_COOKIE, "")
            if not hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode()):
                return "Open the address with the token that the command printed."
        return ""


def _loopback(host: str) -> bool:
    """Whether a Host header names this machine as no other site can: localhost, or a loopback address, at any port."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
