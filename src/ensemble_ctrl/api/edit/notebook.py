"""The editor in a notebook: the same page in a frame below the cell, and the problem back."""

from __future__ import annotations

import asyncio
import atexit
import sys
import tempfile
import threading
from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ensemble_ctrl.core.errors import ProblemError, UnsupportedError
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.core.values import flag, path_of, whole
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.problem import Problem

if TYPE_CHECKING:
    from ensemble_ctrl.api.edit.hub import Hub
    from ensemble_ctrl.api.edit.serving import Server

LIBRARIES = ("starlette", "uvicorn")
"""What the extra ``edit`` installs."""
PATIENCE = 10.0
"""Seconds in which the server has to begin, and to end."""


class Editing:
    """A page on which a problem is edited; in a notebook it is shown in a frame.

    Attributes
    ----------
    address : str
        What a browser opens, with the page's token.
    """

    def __init__(self, file: Path, frames: Sequence[str], height: int, trust: bool) -> None:
        from ensemble_ctrl.api.edit.disk import Disk
        from ensemble_ctrl.api.edit.guard import new_token
        from ensemble_ctrl.api.edit.serving import address_of, bound
        from ensemble_ctrl.api.edit.session import Session

        self._session, self._frames, self._height, self._trust = Session(Disk(file), trust), frames, height, trust
        self._file, self._token, self._sock = file, new_token(), bound()
        self.address = address_of(self._sock, self._token)
        self._hub: Hub | None = None
        self._server: Server | None = None
        self._begun = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._life()), name="editor", daemon=True)
        self._thread.start()
        if not self._begun.wait(PATIENCE):
            raise UnsupportedError("the editor's server did not begin")
        atexit.register(self.close)

    @property
    def text(self) -> str:
        """The problem file as it is on the page now."""
        return self._session.text

    @property
    def problem(self) -> Problem:
        """The problem as it is on the page now.

        Raises
        ------
        ConfigError
            If the text is no problem.
        """
        return load_text(self.text, str(self._file), trust=self._trust)

    @property
    def pages(self) -> int:
        """How many pages show it."""
        return 0 if self._hub is None else self._hub.count

    def close(self) -> None:
        """End the server and the planner; the text stays."""
        atexit.unregister(self.close)
        if self._server is not None:
            self._server.end()
        self._thread.join(PATIENCE)
        self._sock.close()

    async def _life(self) -> None:
        """The server's life, in a thread of its own."""
        from ensemble_ctrl.api.edit.hub import Hub
        from ensemble_ctrl.api.edit.server import application
        from ensemble_ctrl.api.edit.serving import Server, hosts_of

        self._hub = Hub(self._session)
        self._server = Server.of(application(self._hub, self._token, hosts_of(self._sock), self._frames))
        self._begun.set()
        await self._server.life(self._hub, self._sock)

    def __repr__(self) -> str:
        return f"Editing({self._file.name!r}, {self.address})"

    def _repr_html_(self) -> str:
        address = escape(self.address, quote=True)
        link = f'<a href="{address}" target="_blank" rel="noopener">open the editor in a page of its own</a>'
        if not self._frames:
            return f"<p>{link}</p>"
        frame = f'<iframe src="{address}" title="editor" style="width:100%;height:{self._height}px;border:0"></iframe>'
        return f"{frame}<p>{link}</p>"


def edit(
    problem: Problem | str | PathLike[str], *, page: str | None = None, height: int = 760, trust: bool = False
) -> Editing:
    """Edit a problem on the editor's page, in a notebook below the cell.

    Parameters
    ----------
    problem : Problem or path
        What to edit. A path's file is written where one saves on the page; of a `Problem`, saving changes nothing but a
        temporary file.
    page : str, optional
        Origin of the notebook's own page, which alone may show the editor in a frame, as ``http://localhost:8888``;
        without it, those of the Jupyter servers that run on this machine. Where there are none, a link is shown.
    height : int
        Of the frame, pixels.
    trust : bool
        Whether to run the Python file that ``fleet.model`` may name.

    Returns
    -------
    Editing
        Its `Editing.problem` is the problem as it is on the page.

    Raises
    ------
    UnsupportedError
        If the extra ``edit`` is not installed, or on Windows.
    """
    missing = [name for name in LIBRARIES if find_spec(name) is None]
    if missing:
        raise UnsupportedError(f"edit needs {' and '.join(missing)}: pip install 'ensemble-ctrl[edit]'")
    if sys.platform == "win32":
        raise UnsupportedError("edit waits for its planner by pipes, which needs Linux or macOS; use WSL on Windows")
    flag("trust", trust)
    tall = whole("height", height, 1)
    frames = _servers() if page is None else [_origin(page)]
    if isinstance(problem, Problem):
        file = Path(tempfile.mkdtemp(prefix="ensemble-ctrl-")) / f"{_plain(problem.name)}.yaml"
        put_file(file, dump(problem))
    else:
        file = path_of("problem", problem, "a Problem, or the path of a file with one")
    return Editing(file, frames, tall, trust)


def _origin(page: str) -> str:
    """An origin that a policy may name."""
    from ensemble_ctrl.api.edit.guard import ORIGIN

    origin = page.rstrip("/") if isinstance(page, str) else ""
    if not ORIGIN.fullmatch(origin):
        raise ProblemError(f"page: expected an origin such as http://localhost:8888, got {page!r}")
    return origin


def _servers() -> list[str]:
    """Origins of the Jupyter servers that run on this machine."""
    if find_spec("jupyter_server") is None:
        return []
    from jupyter_server.serverapp import list_running_servers

    schemes = {("https" if server.get("secure") else "http", int(server["port"])) for server in list_running_servers()}
    return [f"{scheme}://{host}:{port}" for scheme, port in sorted(schemes) for host in ("localhost", "127.0.0.1")]


def _plain(name: str) -> str:
    """A name as a file's."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name) or "problem"
