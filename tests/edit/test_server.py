"""The editor's command: who may send requests, what it does with files and processes, and how it ends."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ensemble_ctrl.api.edit.guard import MOST_BYTES
from ensemble_ctrl.api.edit.server import page_files
from tests.paths import ROOT

from .editor import PATIENCE, Editor, editor, gone

FIVE = (ROOT / "configs" / "five_obstacles.yaml").read_text(encoding="utf-8")
SMALL = """\
version: 1
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}  # one robot
horizon: {duration: 4 s, steps: 20}
regions:
  goal: {box: [[1, 2], [-0.5, 0.5]]}
task: F[3, 4] in(goal)
verify: {members: 50}
"""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    file = tmp_path_factory.mktemp("edit") / "small.yaml"
    file.write_text(SMALL, encoding="utf-8")
    with editor(file) as one:
        yield one


def test_a_plan_follows_each_change_and_the_file_each_save(running: Editor) -> None:
    first = running.idle()
    assert first["drawing"]["proven"]
    state = running.put(["regions", "goal", "box"], [[1.1, 2.1], [-0.5, 0.5]])
    assert state["valid"]
    assert "goal: {box: [[1.1, 2.1], [-0.5, 0.5]]}" in state["text"]
    assert "# one robot" in state["text"]
    assert running.idle()["drawing"]["proven"]
    file = Path(running.process.args[4])  # type: ignore[index, arg-type]
    assert file.read_text(encoding="utf-8") == SMALL
    running.post("/api/save")
    assert file.read_text(encoding="utf-8") == state["text"]
    running.post("/api/step/undo")
    assert running.post("/api/save")["text"] == SMALL == file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"token": ""}, 401),
        ({"token": "x" * 43}, 401),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "https://127.0.0.1"}, 403),
        ({"Host": "evil.example"}, 421),
        ({"Host": "127.0.0.1"}, 421),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Sec_Fetch_Site": "same-site"}, 403),
        ({"Sec_Fetch_Site": "same-origin"}, 200),
        ({"Content_Length": "1" + "0" * 12}, 413),
        ({"Content_Length": "-1"}, 400),
    ],
)
def test_only_its_own_page_is_answered(running: Editor, headers: dict[str, str], status: int) -> None:
    assert running.request("GET", "/api/state", **headers)[0] == status


def test_the_same_origin_is_answered_and_the_page_needs_no_token(running: Editor) -> None:
    assert running.request("GET", "/api/state", Origin=running.origin)[0] == 200
    assert running.request("GET", "/", token="")[0] == 200
    assert running.request("GET", "/", token="", Host="evil.example")[0] == 421
    assert running.token not in str(running.request("GET", "/", token="")[1])
    assert len(running.token) > 40


def test_other_addresses_of_this_machine_are_closed(running: Editor) -> None:
    port = int(running.host.rpartition(":")[2])
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", port), timeout=5)


@pytest.mark.parametrize(
    "path",
    [
        "/page/../server.py", "/page/%2e%2e/server.py", "/page/..%2fserver.py", "/page/..%2F..%2Fdisk.py",
        "/page//etc/passwd",
        "/page/%2Fetc%2Fpasswd", "/../../etc/passwd", "/page/", "/page/small.yaml", "/small.yaml", "/page/__init__.py",
    ],
)  # fmt: skip
def test_no_file_but_the_page_s_own_is_served(running: Editor, path: str) -> None:
    status, text = running.request("GET", path)
    assert status == 404
    assert "import" not in str(text)
    assert "root:" not in str(text)


def test_answers_say_what_a_browser_may_do_with_them(running: Editor) -> None:
    connection = http.client.HTTPConnection(running.host, timeout=PATIENCE)
    connection.request("GET", "/")
    answer = connection.getresponse()
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "unsafe" not in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Access-Control-Allow-Origin"] is None
    connection.close()


def test_bodies_have_a_limit_also_in_parts(running: Editor) -> None:
    connection = http.client.HTTPConnection(running.host, timeout=PATIENCE)
    parts = (b"x" * 1_000_000 for _ in range(MOST_BYTES // 1_000_000 + 2))
    try:
        connection.request("POST", "/api/text", parts, {"X-Edit-Token": running.token}, encode_chunked=True)
        assert connection.getresponse().status == 413
    except (BrokenPipeError, ConnectionResetError):  # it stopped listening before all was sent
        pass
    connection.close()
    assert running.request("POST", "/api/text", {"text": "#" * 1_100_000, "revision": 1})[0] == 409
    assert running.state()["text"]


BODIES = (b"", b"[", b"[]", b"{}", b"null", b'{"edits": 3}', b"[" * 10_000, b"\xff", b'{"edits": [NaN]}')


@pytest.mark.parametrize("body", BODIES)
def test_requests_that_are_none_are_refused(running: Editor, body: bytes) -> None:
    before = running.state()["revision"]
    for path in ("/api/edit", "/api/text", "/api/import", "/api/step/nothing"):
        status, _ = running.request("POST", path, body)
        assert status in (200, 400, 409)
        assert status != 200 or path == "/api/edit"
    assert running.request("GET", "/api/save")[0] == 405
    assert running.state()["revision"] == before


def test_a_file_outside_of_the_folder_is_not_read(running: Editor) -> None:
    state = running.put(["obstacles", "o1"], {"file": "../secret.geojson"})
    assert not state["valid"]
    assert any("in the same folder or below" in one["message"] for one in state["found"])
    running.post("/api/step/undo")


def test_a_text_from_an_older_revision_is_refused(running: Editor) -> None:
    now = running.state()["revision"]
    assert running.request("POST", "/api/text", {"text": "version: 1\n", "revision": now - 1})[0] == 409
    assert running.state()["revision"] == now


def test_a_killed_planner_is_replaced(running: Editor) -> None:
    running.idle()
    for k in range(2):
        running.put(["regions", "goal", "box", 0, 1], 2.2 + k / 10)
        for pid in running.children():
            os.kill(pid, signal.SIGKILL)
    assert running.idle()["drawing"]["proven"]
    running.post("/api/step/undo")
    running.post("/api/step/undo")
    assert running.idle()["drawing"]["proven"]


def test_python_of_a_problem_file_runs_with_trust_only(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("open('ran', 'w').close()\n", encoding="utf-8")
    file = tmp_path / "own.yaml"
    file.write_text(SMALL.replace("model: unicycle", "model: {python: own.py:Own}"), encoding="utf-8")
    here = Path.cwd()
    os.chdir(tmp_path)
    try:
        with editor(file) as one:
            assert any("--trust" in found["message"] + found["hint"] for found in one.state()["found"])
            assert not (tmp_path / "ran").exists()
        with editor(file, "--trust") as one:
            assert one.state()["found"]
            assert (tmp_path / "ran").exists()
    finally:
        os.chdir(here)


def test_it_ends_with_the_last_page_and_leaves_no_process(tmp_path: Path) -> None:
    file = tmp_path / "new.yaml"
    one = Editor("edit", str(file), "--until-closed")
    state = one.state()
    assert not file.exists()  # it is written when it is saved
    assert state["dirty"]
    assert re.search("task", str(state["found"]))
    connection = http.client.HTTPConnection(one.host, timeout=PATIENCE)
    connection.request("GET", "/api/events", headers={"X-Edit-Token": one.token})
    answer = connection.getresponse()
    assert answer.readline().startswith(b"data: ")
    end = time.monotonic() + 30
    while len(below := one.children()) < 2 and time.monotonic() < end:
        time.sleep(0.1)
    connection.sock.shutdown(socket.SHUT_RDWR)
    connection.close()
    assert one.process.wait(60) == 0
    assert below
    assert all(gone(pid) for pid in below)
    for stream in (one.process.stdout, one.process.stderr):
        assert stream is not None
        stream.close()


def test_the_page_is_small_and_asks_nobody_else() -> None:
    contents = {name: file.read_bytes() for name, file in page_files().items()}
    assert sum(map(len, contents.values())) < 300_000
    for name, content in contents.items():
        links = set(re.findall(rb"https?://[^\s\"'`)]+", content))
        assert links <= {b"http://www.w3.org/2000/svg"}, name
