"""Commands that serve a page, each as a process of its own, and requests to it."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

PATIENCE = 120.0
"""Seconds in which anything has to happen, on a machine that has much else to do."""


class Editor:
    """A running command that serves a page: the editor, or another."""

    def __init__(self, *arguments: str, said_in: str = "stdout") -> None:
        command = [sys.executable, "-m", "ensemble_ctrl.cli", *arguments, "--no-browser"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        stream: IO[str] = getattr(self.process, said_in)
        line = next((line for line in stream if "http://" in line), "")
        if not line:
            assert self.process.stderr is not None
            raise AssertionError(self.process.stderr.read())
        self.address: str = line.partition(": ")[2].strip()
        self.origin, _, self.token = self.address.partition("/#token=")
        self.host = self.origin.removeprefix("http://")

    def request(
        self, method: str, path: str, body: Any = None, token: str | None = None, **headers: str
    ) -> tuple[int, Any]:
        """Status and answer; headers are named with _ for -."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE)
        named = {"X-Edit-Token": self.token if token is None else token} | {
            name.replace("_", "-"): value for name, value in headers.items()
        }
        content = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection.putrequest(method, path, skip_host="Host" in named)
        for name, value in named.items():
            connection.putheader(name, value)
        if content is not None:
            connection.putheader("Content-Length", str(len(content)))
        connection.endheaders(content)
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, json.loads(text) if text[:1] in "{[" else text

    def post(self, path: str, **body: Any) -> dict[str, Any]:
        """A request that is granted."""
        status, found = self.request("POST", path, body)
        assert status == 200, found
        return dict(found)

    def state(self) -> dict[str, Any]:
        """What pages show, with the planner's last events."""
        status, found = self.request("GET", "/api/state")
        assert status == 200, found
        return dict(found)

    def put(self, path: list[str | int], value: Any) -> dict[str, Any]:
        """Put a value into the file's text."""
        return self.post("/api/edit", edits=[{"do": "put", "path": path, "value": value}])

    def idle(self) -> dict[str, Any]:
        """Wait until the text as it is now is planned; the last event with a plan, or why there is none."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            state = self.state()
            last = state["planned"][-1:] or [{"phase": "", "revision": 0}]
            if last[0]["revision"] == state["revision"] and last[0]["phase"] in ("idle", "failed"):
                return dict(next(one for one in state["planned"] if one["phase"] in ("planned", "failed")))
            time.sleep(0.05)
        raise AssertionError("no plan in time")

    def children(self) -> list[int]:
        """Processes below it."""
        found = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if fields[1] == str(self.process.pid) and fields[0] != "Z":
                found.append(int(stat.parent.name))
        return found

    def end(self) -> int:
        """Ctrl-C; the exit code."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(30)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()
        return code


@contextmanager
def served(*arguments: str, said_in: str = "stdout") -> Iterator[Editor]:
    """A command that serves a page, ended afterwards, whatever happens."""
    running = Editor(*arguments, said_in=said_in)
    try:
        yield running
    finally:
        if running.process.poll() is None:
            code = running.end()
            assert code == 0, code


@contextmanager
def editor(file: Path, *options: str) -> Iterator[Editor]:
    """An editor of a file."""
    with served("edit", str(file), *options) as running:
        yield running


def gone(pid: int) -> bool:
    """Whether a process has ended."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False
