"""The editor in a frame of a notebook's page, and the problem back."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.edit.guard import Guard
from ensemble_ctrl.api.edit.notebook import Editing, edit
from tests.report.browser import Page, chromium

from .editor import PATIENCE
from .test_page import BROWSER
from .test_view import SMALL, needs_browser

LEFT = 40.0
"""Seconds in which a page that is left is closed: a browser keeps it, with what it asks for, for a minute."""


@contextmanager
def editing(problem: Any, **options: Any) -> Iterator[Editing]:
    found = edit(problem, **options)
    try:
        yield found
    finally:
        found.close()


def asked(one: Editing, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, dict[str, str], str]:
    """Status, headers and body of a request."""
    origin, _, token = one.address.partition("/#token=")
    connection = http.client.HTTPConnection(origin.removeprefix("http://"), timeout=PATIENCE)
    named = {"X-Edit-Token": token} | {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, None if body is None else json.dumps(body), named)
    answer = connection.getresponse()
    found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read().decode()
    connection.close()
    return found


def until(condition: Any, seconds: float = PATIENCE) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@contextmanager
def notebook(content: str) -> Iterator[str]:
    """A page that shows a notebook's output; its origin."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(content.encode() if self.path == "/" else b"")

        def log_message(self, *_: Any) -> None:
            """Nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://localhost:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()


def test_the_problem_comes_back_as_it_was_changed() -> None:
    problem = ec.load_text(SMALL)
    with editing(problem, page="http://localhost:8888") as one:
        assert one.problem.fleet.radius == problem.fleet.radius
        change = {"do": "put", "path": ["fleet", "radius"], "value": 0.125}
        assert asked(one, "POST", "/api/edit", {"edits": [change]})[0] == 200
        assert one.problem.fleet.radius == 0.125
        assert asked(one, "POST", "/api/edit", {"edits": [{**change, "value": -1.0}]})[0] == 200
        with pytest.raises(ec.ConfigError, match="radius"):
            _ = one.problem
    assert problem.fleet.radius == 0.05  # what was given is as it was
    with pytest.raises(OSError, match="refused"):
        asked(one, "GET", "/")


def test_a_file_is_saved_where_it_is(tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    file.write_text(SMALL, encoding="utf-8")
    with editing(file) as one:
        change = {"do": "put", "path": ["fleet", "radius"], "value": 0.125}
        asked(one, "POST", "/api/edit", {"edits": [change]})
        assert file.read_text(encoding="utf-8") == SMALL
        assert asked(one, "POST", "/api/save", {})[0] == 200
        assert ec.load(file).fleet.radius == 0.125


def test_only_the_notebooks_page_may_frame_it() -> None:
    with editing(ec.load_text(SMALL), page="http://localhost:8888/") as one:
        frame = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "iframe"}
        status, headers, _ = asked(one, "GET", "/", **frame)
        assert status == 200
        assert headers["content-security-policy"].endswith("frame-ancestors http://localhost:8888")
        assert "x-frame-options" not in headers
        # all else is the page's own
        assert asked(one, "GET", "/api/state", **frame)[0] == 403
        assert asked(one, "GET", "/page/app.js", **frame)[0] == 403
        assert asked(one, "GET", "/", Sec_Fetch_Site="cross-site", Sec_Fetch_Dest="script")[0] == 403
        assert asked(one, "GET", "/api/state", X_Edit_Token="no")[0] == 401
        assert asked(one, "POST", "/api/save", {}, Origin="http://localhost:8888")[0] == 403
        assert "<iframe" in one._repr_html_()
    with editing(ec.load_text(SMALL)) as alone:
        if "<iframe" not in alone._repr_html_():  # no Jupyter server runs here
            status, headers, _ = asked(alone, "GET", "/")
            assert headers["x-frame-options"] == "DENY"
            assert headers["content-security-policy"].endswith("frame-ancestors 'none'")
            assert asked(alone, "GET", "/", **frame)[0] == 403


@pytest.mark.parametrize(
    "page",
    ["localhost:8888", "http://a; script-src *", "http://*", "*", "http://a b", "", "https://a/path", "http://é"],
)
def test_what_is_no_origin_is_refused(page: str) -> None:
    with pytest.raises(ec.ProblemError, match="page: expected an origin such as http://localhost:8888"):
        edit(ec.load_text(SMALL), page=page)
    with pytest.raises(ValueError, match="expected an origin"):
        Guard(lambda *_: None, "token", set(), [page])  # type: ignore[arg-type]


def test_what_is_no_problem_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ec.ProblemError, match="problem: expected a Problem, or the path"):
        edit(3)  # type: ignore[arg-type]
    with pytest.raises(ec.ProblemError, match="height: expected 1 or more"):
        edit(ec.load_text(SMALL), height=0)
    with pytest.raises(ec.ConfigError, match="nothing"):
        edit(tmp_path / "nothing.yaml")


@needs_browser
def test_a_notebook_shows_the_page_and_another_page_can_not() -> None:
    assert BROWSER is not None, "CI needs a headless Chromium"
    with chromium(BROWSER) as tab, notebook("<p>cells</p>") as page:
        tab.screen(1000, 900)
        with editing(ec.load_text(SMALL), page=page) as one:
            tab.visit(page)
            _put(tab, one._repr_html_())
            until(lambda: one.pages == 1)
            with notebook(one._repr_html_()) as stranger:
                tab.visit("about:blank")
                until(lambda: one.pages == 0, LEFT)
                tab.run("history.back()")
                until(lambda: tab.run("true") and one.pages == 1)
                tab.visit("about:blank")
                until(lambda: one.pages == 0, LEFT)
                tab.complaints.clear()
                tab.visit(stranger)
                until(lambda: tab.run("true") and any("frame-ancestors" in text for text in tab.complaints))
                assert one.pages == 0


def _put(tab: Page, html: str) -> None:
    """An output into a notebook's page."""
    tab.run(f"document.body.innerHTML = {json.dumps(html)}")
