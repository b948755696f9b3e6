"""Who may talk to the editor: requests of its own page, with its token, from this machine, of bounded size."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BYTES = 6_000_000
"""Bytes of a request's body at most: a map of 5 MB as JSON."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The page loads nothing from elsewhere, and runs no script but its own files."""
HEADERS = [
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]
TOKEN = b"x-edit-token"
"""The header that has the token: no other site can send it without being allowed to."""


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(32)


class Guard:
    """Refuses what does not come from the editor's own page.

    Parameters
    ----------
    app : ASGI application
    token : str
        What requests below ``/api/`` have to bring.
    hosts : set of str
        ``host:port`` under which the page is reached; any other Host or Origin is refused.

    Notes
    -----
    *Guarantee*: a request below ``/api/`` reaches the application only with the token in its header, with a Host among
    `hosts`, and with no Origin or one of those hosts; and the application reads at most `MOST_BYTES` of it.
    """

    def __init__(self, app: App, token: str, hosts: set[str]) -> None:
        self.app, self.token, self.hosts = app, token.encode(), {host.encode() for host in hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(send, *refusal)
            return
        await self.app(scope, _limited(receive), _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Why a request is refused; None for a good one."""
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        hosts = headers.get(b"host", [])
        if len(hosts) != 1 or hosts[0] not in self.hosts:
            return 421, "this address is not the editor's"
        origins = headers.get(b"origin", [])
        if any(origin.removeprefix(b"http://") not in self.hosts for origin in origins):
            return 403, "the request comes from another page"
        if any(site not in (b"same-origin", b"none") for site in headers.get(b"sec-fetch-site", [])):
            return 403, "the request comes from another page"
        if scope["path"].startswith("/api/"):
            tokens = headers.get(TOKEN, [])
            if len(tokens) != 1 or not hmac.compare_digest(tokens[0], self.token):
                return 401, "open the address that the command printed: it has the token"
        sizes = headers.get(b"content-length", [])
        if any(not size.isdigit() or int(size) > MOST_BYTES for size in sizes):
            return 413, f"expected at most {MOST_BYTES // 1_000_000} MB"
        return None


class TooLargeError(Exception):
    """A body is larger than it may be."""


def _limited(receive: Receive) -> Receive:
    """What is received, up to a size."""
    count = 0

    async def limited() -> Message:
        nonlocal count
        message = await receive()
        count += len(message.get("body", b""))
        if count > MOST_BYTES:
            raise TooLargeError
        return message

    return limited


def _with_headers(send: Send) -> Send:
    """Answers with the headers that every one of them has."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *HEADERS]}
        await send(message)

    return sending


async def _refuse(send: Send, status: int, why: str) -> None:
    """A short answer."""
    content = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": content})
    await send({"type": "http.response.body", "body": why.encode()})
