"""The process that serves the page of a running command, which sends it lines of JSON on its standard input.

It is a process of its own because a solve may keep Python's lock for long, and because signals are the command's own.
The first line is what pages show, each further one an event, and one of kind ``done`` says that no more will come: from
then on it ends with its last page.  It ends with its input, too, and so with the command, however that ends.
"""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import threading

from ensemble_ctrl.api.edit.exhibit import Exhibit
from ensemble_ctrl.api.edit.pages import Event
from ensemble_ctrl.api.edit.server import showing
from ensemble_ctrl.api.edit.serving import Server, hosts_of


def main(descriptor: int, token: str) -> None:
    """Serve on a socket that the parent has bound."""
    with socket.socket(fileno=descriptor) as sock:
        asyncio.run(_serve(sock, token))


async def _serve(sock: socket.socket, token: str) -> None:
    """The server's life."""
    lines, loop, done = sys.stdin.buffer, asyncio.get_running_loop(), False
    first = lines.readline()
    if not first:
        return

    def closed() -> None:
        if done:
            server.end()

    def take(event: Event) -> None:
        nonlocal done
        pages.publish(event)
        if event["kind"] == "done":
            done = True
            if pages.left:
                server.end()

    def listen() -> None:
        for line in lines:
            loop.call_soon_threadsafe(take, json.loads(line))
        loop.call_soon_threadsafe(server.end)

    pages = Exhibit(json.loads(first), closed)
    server = Server.of(showing(pages, token, hosts_of(sock)))
    threading.Thread(target=listen, daemon=True).start()
    await server.life(pages, sock)
