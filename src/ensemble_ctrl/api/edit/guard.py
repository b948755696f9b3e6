"""Who may talk to the editor: requests of its own page, with its token, from this machine, of bounded size."""

from __future__ import annotations

import hmac
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
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
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors "
)
"""The page loads nothing from elsewhere, and runs no script but its own files; last comes who may frame it."""
HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]
TOKEN = b"x-edit-token"
"""The header that has the token: no other site can send it without being allowed to."""


ORIGIN = re.compile(r"https?://(?:[a-z0-9-]+(?:\.[a-z0-9-]+)*|\[[0-9a-f:]+\])(?::[0-9]{1,5})?", re.ASCII)
"""What may be named as a page that frames this one: nothing that a policy would read otherwise."""
Headers = list[tuple[bytes, bytes]]


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
    frames : sequence of str
        Origins of pages that may show this one in a frame, as ``http://localhost:8888``; none if not given.

    Raises
    ------
    ValueError
        If one of `frames` is no origin.

    Notes
    -----
    *Guarantee*: a request below ``/api/`` reaches the application only with the token in its header, with a Host among
    `hosts`, and with no Origin or one of those hosts; and the application reads at most `MOST_BYTES` of it.
    With `frames`, the empty page at ``/`` may be opened from elsewhere as a frame, which only those origins can show;
    requests below ``/api/`` come from the page itself all the same.
    """

    def __init__(self, app: App, token: str, hosts: set[str], frames: Sequence[str] = ()) -> None:
        self.app, self.token, self.hosts = app, token.encode(), {host.encode() for host in hosts}
        for frame in frames:
            if not ORIGIN.fullmatch(frame):
                raise ValueError(f"expected an origin such as http://localhost:8888, got {frame!r}")
        policy = POLICY + (" ".join(frames) if frames else "'none'")
        self._headers: Headers = [(b"content-security-policy", policy.encode()), *HEADERS]
        self._headers += [] if frames else [(b"x-frame-options", b"DENY")]
        self._framed = bool(frames)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            await _refuse(send, *refusal, self._headers)
            return
        await self.app(scope, _limited(receive), _with_headers(send, self._headers))

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
        framed = self._framed and scope["path"] == "/" and headers.get(b"sec-fetch-dest") == [b"iframe"]
        if not framed and any(site not in (b"same-origin", b"none") for site in headers.get(b"sec-fetch-site", [])):
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


def _with_headers(send: Send, headers: Headers) -> Send:
    """Answers with the headers that every one of them has."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *headers]}
        await send(message)

    return sending


async def _refuse(send: Send, status: int, why: str, headers: Headers) -> None:
    """A short answer."""
    content = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"), *headers]
    await send({"type": "http.response.start", "status": status, "headers": content})
    await send({"type": "http.response.body", "body": why.encode()})
