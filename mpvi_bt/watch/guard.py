"""Who may ask the server: browsers that show its own page, with the token where other machines can reach it."""

from __future__ import annotations

import hmac
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_COOKIE = "mpvi_token"
_HEADERS = (
    (b"cache-control", b"no-store"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"SAMEORIGIN"),
)


class PageGuard:
    """Lets through what comes from the server's own page.

    A page of another site can make a browser send requests here, but not without naming itself as their Origin; and a
    name that another site has pointed at this machine stands in Host. Both are looked at. Where a token is set, the
    page's address brings it once, and a cookie from then on; programs send it in their address, or as a bearer.
    """

    def __init__(self, app: ASGIApp, port: int, token: str = "") -> None:
        """Guard `app`, which listens on `port`."""
        self._app, self._port, self._token = app, port, token

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
        elif "token" in request.query_params and "text/html" in request.headers.get("accept", ""):
            answer = RedirectResponse(scope["path"], 303)
            answer.set_cookie(_COOKIE, self._token, httponly=True, samesite="strict", path="/")

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_HEADERS]
            await send(message)

        await (answer or self._app)(scope, receive, sending)

    def _refusal(self, request: HTTPConnection) -> str:
        """Why not, or ""."""
        host = request.headers.get("host", "")
        if not self._token and host not in {f"{name}:{self._port}" for name in ("127.0.0.1", "localhost", "[::1]")}:
            return "this server is asked by the name 127.0.0.1 or localhost"
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return "this was asked by the page of another site"
        if self._token:
            bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
            given = request.query_params.get("token") or bearer or request.cookies.get(_COOKIE, "")
            if not hmac.compare_digest(given.encode(), self._token.encode()):
                return "open the address with the token that the command printed"
        return ""
