"""The HTTP server of a page: on this machine only, until it is told to end (uvicorn)."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn

from ensemble_ctrl.api.edit.guard import Guard
from ensemble_ctrl.api.edit.pages import Pages

HOST = "127.0.0.1"
TICK = 0.1
"""Seconds between two looks at whether the server is to end."""


def bound(port: int = 0) -> socket.socket:
    """A socket on this machine only, on which requests wait until they are answered.

    Raises
    ------
    OSError
        If the port is taken.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port))
        sock.listen(100)
    except OSError:
        sock.close()
        raise
    return sock


def hosts_of(sock: socket.socket) -> set[str]:
    """``host:port`` under which a server on `sock` is reached."""
    number = sock.getsockname()[1]
    return {f"{HOST}:{number}", f"localhost:{number}"}


def address_of(sock: socket.socket, token: str) -> str:
    """What a browser opens; the token is behind the ``#``, which no browser sends anywhere."""
    return f"http://{HOST}:{sock.getsockname()[1]}/#token={token}"


class Server(uvicorn.Server):
    """Without a second round of the signal that ended it: Ctrl-C is how a page ends."""

    @classmethod
    def of(cls, app: Guard) -> Server:
        """For one application."""
        return cls(
            uvicorn.Config(
                app,
                log_level="warning",
                lifespan="off",
                timeout_graceful_shutdown=2,
                ws="none",
                server_header=False,
            )
        )

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Within: the first signal asks to end."""
        with super().capture_signals():
            try:
                yield
            finally:
                self._captured_signals.clear()

    def end(self) -> None:
        """Ask it to end."""
        self.should_exit = True

    async def life(self, pages: Pages, sock: socket.socket) -> None:
        """Serve until it is to end; streams end first, for they would keep it waiting."""
        closing = asyncio.create_task(self._close_streams(pages))
        try:
            await self.serve(sockets=[sock])
        finally:
            closing.cancel()
            pages.close()

    async def _close_streams(self, pages: Pages) -> None:
        """Once the server is to end."""
        while not self.should_exit:
            await asyncio.sleep(TICK)
        pages.end_streams()
