"""A headless Chromium driven over a pipe (Chrome DevTools Protocol), with the standard library only."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

FLAGS = """--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync --remote-debugging-pipe --hide-scrollbars"""


def executable() -> str:
    """Path of Chromium, or skip the calling test."""
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("Chromium is not installed")
    return found


@pytest.fixture(autouse=True)
def quiet_page(browser):
    """Whatever a test does with a page, it may raise no error and ask for nothing outside its folder."""
    browser.errors.clear()
    browser.requests.clear()
    yield
    browser.evaluate("1")
    assert not browser.errors
    assert not [r for r in browser.requests if not r.startswith(("file:", "data:", "blob:"))]


class PageLeft(Exception):
    """The page was left for another one while it was asked something."""


class Browser:
    """One page in a fresh browser; collects console errors and the addresses that the page asks for."""

    def __init__(self) -> None:
        chromium = executable()
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        commands, self._send = os.pipe()
        self._receive, answers = os.pipe()

        def connect() -> None:  # the protocol's pipes are descriptors 3 (in) and 4 (out)
            first, second = os.dup(commands), os.dup(answers)
            os.dup2(first, 3)
            os.dup2(second, 4)

        self._process = subprocess.Popen(
            [chromium, *FLAGS.split(), f"--user-data-dir={self._profile.name}", "about:blank"],
            preexec_fn=connect, close_fds=False, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        self._buffer, self._number, self._session = b"", 0, ""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its answer; events that come in between are noted."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "navigated or closed" in answer.get("error", {}).get("message", ""):
                    raise PageLeft
                assert "error" not in answer, answer["error"]
                return answer["result"]
            self._note(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            received = os.read(self._receive, 1 << 20)
            assert received, "the browser has gone"
            self._buffer += received
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)

    def _note(self, event: dict[str, Any]) -> None:
        details = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                self.errors.append(json.dumps(details)[:500])
            case "Log.entryAdded" if details["entry"]["level"] in ("error", "warning"):
                self.errors.append(details["entry"]["text"])
            case "Network.requestWillBeSent":
                self.requests.append(details["request"]["url"][:200])

    def open(self, path: Path, *, width: int = 1200, dark: bool = False, fragment: str = "") -> float:
        """Open a file, until its figures are there, and return the seconds until its text was."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url="about:blank")  # else a page that is there already stays, drawn for its window
        began = time.perf_counter()
        self.call("Page.navigate", url=path.as_uri() + fragment)
        self.wait("document.readyState !== 'loading' && location.protocol === 'file:'")
        shown = time.perf_counter() - began
        self.wait("document.readyState === 'complete'")
        return shown

    def evaluate(self, expression: str) -> Any:
        """Value of a JavaScript expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str, seconds: float = 20.0) -> None:
        """Wait until a JavaScript condition is true."""
        until = time.perf_counter() + seconds
        while not self._holds(condition):
            assert time.perf_counter() < until, f"not within {seconds} s: {condition}"
            time.sleep(0.02)

    def _holds(self, condition: str) -> bool:
        try:
            return bool(self.evaluate(condition))
        except PageLeft:  # the next page will answer
            return False

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(10)
        os.close(self._send)
        os.close(self._receive)
        self._profile.cleanup()


def settled(browser: Any, expression: str, wanted: object, seconds: float = 5.0) -> object:
    """Value of an expression as soon as it is as wanted, else what it is after some seconds: figures fit themselves to
    the window after they have been drawn."""
    end = time.monotonic() + seconds
    while (found := browser.evaluate(expression)) != wanted and time.monotonic() < end:
        time.sleep(0.05)
    return found
