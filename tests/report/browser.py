"""A headless Chromium, spoken to over a pipe in its own protocol, where one is installed."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE = 60.0
"""Seconds to wait for an answer."""


def executable() -> str | None:
    """The browser's path, if there is one."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One tab; `complaints` collects everything that the console or the log says, and `requests` what was fetched."""

    _loaded = False

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._out, self._in = os.fdopen(to_browser, "wb"), from_browser
        self._buffer, self._count, self._session = b"", 0, ""
        self.complaints: list[str] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = self._send(method, parameters)
        while True:
            answer = self._next()
            if answer.get("id") == number:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def open(self, path: Path) -> None:
        """Load a file and wait until it is there."""
        self.visit(path.resolve().as_uri())

    def visit(self, address: str) -> None:
        """Load an address and wait until it is there."""
        self._loaded = False
        self.call("Page.navigate", url=address)
        while not self._loaded:
            self._next()

    def reload(self) -> None:
        """Load the page anew."""
        self._loaded = False
        self.call("Page.reload")
        while not self._loaded:
            self._next()

    def mouse(self, kind: str, x: float, y: float, held: int = 0, modifiers: int = 0) -> None:
        """A mouse event, ``mousePressed``, ``mouseMoved`` or ``mouseReleased``, at a place of the window."""
        button = {} if kind == "mouseMoved" and not held else {"button": "left", "clickCount": 1}
        more = {"buttons": held, "modifiers": modifiers}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button, **more)

    def click(self, x: float, y: float, modifiers: int = 0) -> None:
        """Press and release."""
        self.mouse("mousePressed", x, y, 1, modifiers)
        self.mouse("mouseReleased", x, y, 0, modifiers)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 6) -> None:
        """Press, move in some steps, release."""
        self.mouse("mousePressed", *start, held=1)
        for k in range(1, steps + 1):
            x, y = (a + (b - a) * k / steps for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, held=1)
        self.mouse("mouseReleased", *end)

    def key(self, key: str, modifiers: int = 0, code: int = 0) -> None:
        """Press and release a key by its name; a letter is typed."""
        text = {"text": key} if len(key) == 1 and not modifiers else {}
        for kind in ("keyDown", "keyUp"):
            more = text if kind == "keyDown" else {}
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers, windowsVirtualKeyCode=code, **more
            )

    def type(self, text: str) -> None:
        """Type a text where the focus is."""
        self.call("Input.insertText", text=text)

    def run(self, expression: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        done = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def screen(self, width: int, height: int, dark: bool = False) -> None:
        """Another window, and light or dark mode."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        mode = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[mode])

    def picture(self) -> bytes:
        """The whole page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", captureBeyondViewport=True)["data"])

    def _send(self, method: str, parameters: dict[str, Any]) -> int:
        """Ask for a method without waiting; the number of the question."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        message |= {"sessionId": self._session} if self._session else {}
        self._out.write(json.dumps(message).encode() + b"\0")
        self._out.flush()
        return self._count

    def _next(self) -> dict[str, Any]:
        """The next message; what the page complains of is kept."""
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._buffer:
            assert time.monotonic() < end, "the browser does not answer"
            more = os.read(self._in, 1 << 20)
            assert more, "the browser has ended"
            self._buffer += more
        raw, _, self._buffer = self._buffer.partition(b"\0")
        message: dict[str, Any] = json.loads(raw)
        kind, data = message.get("method", ""), message.get("params", {})
        if kind == "Page.loadEventFired":
            self._loaded = True
        elif kind in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"):
            self.complaints.append(json.dumps(data)[:500])
        elif kind == "Page.javascriptDialogOpening":  # whether to leave a page with something unsaved
            self._send("Page.handleJavaScriptDialog", {"accept": True})
        elif kind == "Network.requestWillBeSent":
            self.requests.append(data["request"]["url"])
        return message


@contextmanager
def chromium(path: str) -> Iterator[Page]:
    """A page of a browser of its own, which is ended afterwards."""
    command = [
        path,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--remote-debugging-pipe",
        "--disable-dev-shm-usage",
    ]
    near_in, far_out = os.pipe()
    far_in, near_out = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (far_in, far_out)]
        browser = subprocess.Popen(
            [*command, f"--user-data-dir={profile}"],
            pass_fds=(3, 4),
            preexec_fn=lambda: [os.dup2(end, place) for end, place in zip(ends, (3, 4), strict=True)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in (far_in, far_out, *ends):
            os.close(end)
        try:
            yield Page(near_out, near_in)
        finally:
            browser.terminate()
            browser.wait(timeout=20)
            os.close(near_in)
