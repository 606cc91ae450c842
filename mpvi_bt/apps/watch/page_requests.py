"""A page's requests and answers: HTML under a content policy, and checked JSON."""

from __future__ import annotations

import html
import json
import re
from collections.abc import AsyncIterator
from typing import Any

from starlette.requests import Request
from starlette.responses import HTMLResponse

_POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">')
_FRAMES = "frame-ancestors 'self'; form-action 'none'"  # which a policy inside a page cannot say


def page_response(page: str) -> HTMLResponse:
    """A page, with the content policy that it has inside as a header too; one without a policy may load nothing."""
    found = _POLICY.search(page)
    policy = html.unescape(found[1]) if found else "default-src 'none'"
    return HTMLResponse(page, headers={"content-security-policy": f"{policy}; {_FRAMES}"})


async def posted(request: Request, most_bytes: int) -> Any:
    """The JSON that was sent.

    Args:
        request: With the body.
        most_bytes: Of the body.

    Raises:
        ValueError: It is too long, no JSON, nested too deep, or has a text that no file can hold (half of a surrogate
            pair).
    """
    sent = b""
    stream: AsyncIterator[bytes] = request.stream()
    async for part in stream:
        sent += part
        if len(sent) > most_bytes:
            raise ValueError("too long")
    try:
        said = json.loads(sent)
    except RecursionError:
        raise ValueError("nested too deep") from None
    json.dumps(said, ensure_ascii=False).encode()  # UnicodeEncodeError is a ValueError
    return said
