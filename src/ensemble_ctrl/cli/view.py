"""``ensemble-plan view``: saved plans over each other on one page, with a table of what differs."""

from __future__ import annotations

import asyncio
import webbrowser
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.edit import open_page
from ensemble_ctrl.cli.show import judged
from ensemble_ctrl.cli.streams import complain, say

if TYPE_CHECKING:
    import socket


def view_plans(paths: Sequence[Path], port: int, browser: bool, until_closed: bool) -> int:
    """Judge each plan again, and serve the page until Ctrl-C, or until its last page is closed.

    Raises
    ------
    EnsembleError
        If a library is missing, a plan can't be read or drawn with the others, or the port is taken.
    """
    with open_page("view", port) as sock, suppress(KeyboardInterrupt):
        from ensemble_ctrl.api.edit.overlay import overlay

        names = names_of(paths)
        state = overlay({name: judged(path) for name, path in zip(names, paths, strict=True)})
        asyncio.run(_serve(state, sock, browser, until_closed))
    return codes.OK


def names_of(paths: Sequence[Path]) -> list[str]:
    """What plans are called: their folder or file; where two are called the same, as they were given."""
    short = [(path.parent.name if path.name == "plan.npz" else path.stem) or str(path) for path in paths]
    named = [name if short.count(name) == 1 else str(path) for name, path in zip(short, paths, strict=True)]
    return [name if named.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(named)]


async def _serve(state: dict[str, Any], sock: socket.socket, browser: bool, until_closed: bool) -> None:
    """The server's life."""
    from ensemble_ctrl.api.edit.exhibit import Exhibit
    from ensemble_ctrl.api.edit.guard import new_token
    from ensemble_ctrl.api.edit.server import showing
    from ensemble_ctrl.api.edit.serving import Server, address_of, hosts_of

    def end() -> None:
        server.end()

    token = new_token()
    pages = Exhibit(state, end if until_closed else None)
    server = Server.of(showing(pages, token, hosts_of(sock)))
    address = address_of(sock, token)
    say(f"{state['file']}: {address}")
    complain("Ctrl-C ends it")
    if browser:
        webbrowser.open(address)
    await server.life(pages, sock)
