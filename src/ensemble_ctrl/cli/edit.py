"""``ensemble-plan edit``: serve the editor's page on this machine until Ctrl-C."""

from __future__ import annotations

import asyncio
import socket
import sys
import webbrowser
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.errors import UnsupportedError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import uvicorn

    from ensemble_ctrl.api.edit.hub import Hub

HOST = "127.0.0.1"
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
    missing = [name for name in LIBRARIES if find_spec(name) is None]
    if missing:
        raise UnsupportedError(f"edit needs {' and '.join(missing)}: pip install 'ensemble-ctrl[edit]'")
    if sys.platform == "win32":
        raise UnsupportedError("edit waits for its planner by pipes, which needs Linux or macOS; use WSL on Windows")
    if not file.parent.is_dir():
        raise UsageError(f"{file}: there is no folder {file.parent}")
    with _bound(port) as sock, suppress(KeyboardInterrupt):  # it may come before the server listens to it
        asyncio.run(_serve(file, sock, browser, until_closed, trust))
    return codes.OK


@contextmanager
def _bound(port: int) -> Iterator[socket.socket]:
    """A socket on this machine only."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port))
        sock.listen(100)  # from now on, requests wait until they are answered
    except OSError as error:
        sock.close()
        raise UsageError(f"--port {port}: {error.strerror}; leave it out for a free one") from None
    with sock:
        yield sock


async def _serve(file: Path, sock: socket.socket, browser: bool, until_closed: bool, trust: bool) -> None:
    """The server's life."""
    import uvicorn

    from ensemble_ctrl.api.edit.disk import Disk
    from ensemble_ctrl.api.edit.guard import new_token
    from ensemble_ctrl.api.edit.hub import Hub
    from ensemble_ctrl.api.edit.server import application
    from ensemble_ctrl.api.edit.session import Session

    class Server(uvicorn.Server):
        """Without a second round of the signal that ended it: Ctrl-C is how the editor ends."""

        @contextmanager
        def capture_signals(self) -> Iterator[None]:
            with super().capture_signals():
                try:
                    yield
                finally:
                    self._captured_signals.clear()

    session = Session(Disk(file), trust, None if file.exists() else EMPTY)
    number = sock.getsockname()[1]
    token = new_token()

    def end() -> None:
        server.should_exit = True

    hub = Hub(session, end if until_closed else None)
    hosts = {f"{HOST}:{number}", f"localhost:{number}"}
    config = uvicorn.Config(
        application(hub, token, hosts), log_level="warning", lifespan="off", timeout_graceful_shutdown=2, ws="none",
        server_header=False,
    )  # fmt: skip
    server = Server(config)
    address = f"http://{HOST}:{number}/#token={token}"
    say(f"{file}: {address}")
    complain("Ctrl-C ends it; what is not saved is lost then")
    if browser:
        webbrowser.open(address)
    closing = asyncio.create_task(_close_streams(server, hub))
    try:
        await server.serve(sockets=[sock])
    finally:
        closing.cancel()
        hub.close()


async def _close_streams(server: uvicorn.Server, hub: Hub) -> None:
    """End the pages' streams once the server is to end: they would keep it waiting."""
    while not server.should_exit:
        await asyncio.sleep(0.1)
    hub.end_streams()
