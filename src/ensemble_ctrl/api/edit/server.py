"""The editor's server: the page's files, its requests, and the stream of what changes (Starlette on uvicorn).

Both are small, typed, and plain Python without compiled parts (extra ``edit``).  Everything lies behind `Guard`.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from ensemble_ctrl.api.edit.guard import Guard, TooLargeError
from ensemble_ctrl.api.edit.hub import Hub
from ensemble_ctrl.api.edit.importing import imported
from ensemble_ctrl.api.edit.pages import Pages
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config import schema

KINDS = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
"""Media types of the page's files."""
DRAWING = "drawing.css"
"""Colours and lines of drawings, as in ``report.html``."""
BEAT = 10.0
"""Seconds of silence after which a stream says that it is alive."""
Handler = Callable[[Request], Awaitable[Response]]


def showing(pages: Pages, token: str, hosts: set[str]) -> Guard:
    """A server of pages that show something and change nothing, as an ASGI application.

    Parameters
    ----------
    pages : Pages
        What is shown.
    token : str
        What requests have to bring.
    hosts : set of str
        ``host:port`` under which it is reached.
    """
    return Guard(Starlette(routes=_routes(pages)), token, hosts)


def application(hub: Hub, token: str, hosts: set[str], frames: Sequence[str] = ()) -> Guard:
    """The editor's server as an ASGI application.

    Parameters
    ----------
    hub : Hub
        What is edited and planned.
    token : str
        What requests have to bring.
    hosts : set of str
        ``host:port`` under which it is reached.
    frames : sequence of str
        Origins of pages that may show it in a frame.
    """
    session = hub.session
    described = json.dumps(schema())

    async def schema_of(_: Request) -> Response:
        return Response(described, media_type="application/json")

    async def edit(request: Request) -> Response:
        given = await _body(request)
        group = given.get("group")
        dragging = bool(given.get("dragging"))
        return await hub.change(lambda: session.edit(given.get("edits", []), group and str(group)), dragging)

    async def text(request: Request) -> Response:
        given = await _body(request)
        content, revision = given.get("text"), given.get("revision")
        if not isinstance(content, str) or not isinstance(revision, int):
            return JSONResponse({"error": "expected a text and the revision that it is a change of"}, 400)
        return await hub.change(lambda: session.replace(content, revision))

    async def step(request: Request) -> Response:
        action = {"undo": session.undo, "redo": session.redo, "reload": session.reload}[request.path_params["step"]]
        return await hub.change(action)

    async def save(request: Request) -> Response:
        force = bool((await _body(request)).get("force"))
        return await hub.change(lambda: session.save(force))

    async def add_map(request: Request) -> Response:
        given = await _body(request)
        edits = await asyncio.to_thread(imported, str(given.get("name")), str(given.get("content")), session)
        return await hub.change(lambda: session.edit(edits))

    async def replan(_: Request) -> Response:
        hub.plan()
        return JSONResponse({})

    posts: dict[str, Handler] = {
        "/api/edit": edit,
        "/api/text": text,
        "/api/step/{step:str}": step,
        "/api/save": save,
        "/api/import": add_map,
        "/api/plan": replan,
    }
    routes = [Route(path, _safe(handler), methods=["POST"]) for path, handler in posts.items()]
    routes += [Route("/api/schema", schema_of, methods=["GET"]), *_routes(hub)]
    return Guard(Starlette(routes=routes), token, hosts, frames)


def _routes(pages: Pages) -> list[Route]:
    """What every page asks for: its files, what it shows, and the stream of what changes."""

    async def state(_: Request) -> Response:
        return JSONResponse({**pages.state(), "planned": pages.first()})

    async def events(_: Request) -> Response:
        return StreamingResponse(_stream(pages), media_type="text/event-stream")

    gets: dict[str, Handler] = {
        "/api/state": state,
        "/api/events": events,
        "/": _page_file,
        "/page/{name:str}": _page_file,
    }
    return [Route(path, handler, methods=["GET"]) for path, handler in gets.items()]


def _safe(handler: Handler) -> Handler:
    """A handler whose errors are answers."""

    async def answer(request: Request) -> Response:
        try:
            return await handler(request)
        except TooLargeError:
            return JSONResponse({"error": "the request is too large"}, 413)
        except EnsembleError as error:
            return JSONResponse({"error": str(error)}, 409)
        except OSError as error:
            return JSONResponse({"error": f"{error.filename or 'file'}: {error.strerror or error}"}, 409)
        except (ValueError, KeyError, RecursionError) as error:
            return JSONResponse({"error": f"not a request of this page ({type(error).__name__})"}, 400)

    return answer


async def _body(request: Request) -> dict[str, Any]:
    """The request's JSON section.

    Raises
    ------
    ValueError
        If it is none.
    """
    given = json.loads(await request.body() or b"{}")
    if not isinstance(given, dict):
        raise ValueError("expected a section")
    return given


async def _page_file(request: Request) -> Response:
    """One of the page's own files, by a name from its folder's list."""
    name = request.path_params.get("name", "index.html")
    file = page_files().get(name)
    if file is None:
        return Response("there is no such file", 404, media_type="text/plain")
    return Response(file.read_bytes(), media_type=KINDS[Path(name).suffix])


@cache
def page_files() -> dict[str, Traversable]:
    """The page's files by name; the report's colours and lines are used here too."""
    found = {file.name: file for file in files("ensemble_ctrl.api.edit").joinpath("page").iterdir()}
    found[DRAWING] = files("ensemble_ctrl.report").joinpath(DRAWING)
    return {name: file for name, file in found.items() if Path(name).suffix in KINDS}


async def _stream(pages: Pages) -> AsyncIterator[str]:
    """Server-sent events: the state, then whatever changes; a comment where nothing does."""
    with pages.listening() as queue:
        yield _event({"kind": "state", **pages.state()})
        for what in pages.first():
            yield _event(what)
        while not pages.closing.is_set():
            try:
                yield _event(await asyncio.wait_for(queue.get(), BEAT))
            except TimeoutError:
                yield ": alive\n\n"


def _event(what: dict[str, Any]) -> str:
    """One event."""
    return f"data: {json.dumps(what, allow_nan=False)}\n\n"
