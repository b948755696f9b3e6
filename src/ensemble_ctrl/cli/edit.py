"""``ensemble-plan edit``: serve the editor's page on this machine until Ctrl-C."""

from __future__ import annotations

import asyncio
import sys
import webbrowser
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.errors import UnsupportedError

if TYPE_CHECKING:
    import socket

EMPTY = """\
# Drawn with `ensemble-plan edit`: put the start where it belongs, then draw obstacles and way-points.
version: 1
fleet:
  model: unicycle
  parameters:
    traction: {range: [0.9, 1.1]}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [0, 1], omega: [-1.5, 1.5]}
  radius: 5 cm
horizon: {duration: 10 s, steps: 100}
"""
"""What a new file begins with."""
LIBRARIES = ("starlette", "uvicorn")
"""What the extra ``edit`` installs."""


def edit_file(file: Path, port: int, browser: bool, until_closed: bool, trust: bool) -> int:
    """Serve the page of one problem file until Ctrl-C, or until its last page is closed.

    Raises
    ------
    EnsembleError
        If a library is missing, the file can't be read, or the port is taken.
    """
    if sys.platform == "win32":
        raise UnsupportedError("edit waits for its planner by pipes, which needs Linux or macOS; use WSL on Windows")
    if not file.parent.is_dir():
        raise UsageError(f"{file}: there is no folder {file.parent}")
    with open_page("edit", port) as sock, suppress(KeyboardInterrupt):  # it may come before the server listens to it
        asyncio.run(_serve(file, sock, browser, until_closed, trust))
    return codes.OK


def open_page(command: str, port: int = 0) -> socket.socket:
    """The socket of a page that a command serves, on this machine only.

    Raises
    ------
    EnsembleError
        If a library is missing, or the port is taken.
    """
    missing = [name for name in LIBRARIES if find_spec(name) is None]
    if missing:
        raise UnsupportedError(f"{command} needs {' and '.join(missing)}: pip install 'ensemble-ctrl[edit]'")
    from ensemble_ctrl.api.edit.serving import bound

    try:
        return bound(port)
    except OSError as error:
        raise UsageError(f"--port {port}: {error.strerror}; leave it out for a free one") from None


async def _serve(file: Path, sock: socket.socket, browser: bool, until_closed: bool, trust: bool) -> None:
    """The server's life."""
    from ensemble_ctrl.api.edit.disk import Disk
    from ensemble_ctrl.api.edit.guard import new_token
    from ensemble_ctrl.api.edit.hub import Hub
    from ensemble_ctrl.api.edit.server import application
    from ensemble_ctrl.api.edit.serving import Server, address_of, hosts_of
    from ensemble_ctrl.api.edit.session import Session

    def end() -> None:
        server.end()

    session = Session(Disk(file), trust, None if file.exists() else EMPTY)
    token = new_token()
    hub = Hub(session, end if until_closed else None)
    server = Server.of(application(hub, token, hosts_of(sock)))
    address = address_of(sock, token)
    say(f"{file}: {address}")
    complain("Ctrl-C ends it; what is not saved is lost then")
    if browser:
        webbrowser.open(address)
    await server.life(hub, sock)
