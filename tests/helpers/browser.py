"""A headless Chromium that a test drives through its debugging pipe."""

from __future__ import annotations

import base64
import json
import os
import re
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-extensions", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-gpu-compositing", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"),
    *("--hide-scrollbars", "--remote-debugging-pipe"),
)
LOOK = (Path(__file__).parent / "look.js").read_text(encoding="utf-8")
SLOW = "GPU stall|willReadFrequently"
"""What Chromium says of drawing without a graphics card."""
PATIENCE = 120
"""s, for an answer; without a graphics card views in space are slow to draw."""
WATCH = """
window.testErrors = [];
addEventListener("error", (event) => testErrors.push(event.message));
addEventListener("unhandledrejection", (event) => testErrors.push(String(event.reason)));
"""


class Browser:
    """One page at a time, in real time."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, read
        self._left, self._number, self._session = b"", 0, ""
        self.console: list[str] = []
        """What was logged since the page was opened."""
        targets = self._send("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        attached = self._send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._send(f"{domain}.enable")
        self._send("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        self._send("Emulation.setFocusEmulationEnabled", enabled=True)

    def open(self, page: Path | str, width: int, height: int = 700) -> None:
        """Load a page, a file or at an address of this machine, in a window of this size, px."""
        self.resize(width, height)
        self.console.clear()
        self._send("Page.navigate", url="about:blank")
        address = page.as_uri() if isinstance(page, Path) else page
        self._send("Page.navigate", url=address)
        loaded = f"{address.partition(':')[0]}:complete"
        self.wait(f"location.protocol + document.readyState === {loaded!r}")

    def resize(self, width: int, height: int = 700) -> None:
        """Give the window a size, px."""
        self._send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def wait(self, script: str) -> Any:
        """The value of an expression once it is true."""
        until = time.monotonic() + PATIENCE
        while not (value := self.ask(script)):
            assert time.monotonic() < until, f"never true: {script}"
            time.sleep(0.05)
        return value

    def ask(self, script: str) -> Any:
        """The value of an expression, or of the promise that it is."""
        answer = self._send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key where the focus is."""
        for kind in ("keyDown", "keyUp"):
            self._send("Input.dispatchKeyEvent", type=kind, key=key, code=key, **KEYS.get(key, {}))

    def pdf(self) -> bytes:
        """The page as it prints."""
        answer = self._send("Page.printToPDF", printBackground=False, preferCSSPageSize=True)
        return base64.b64decode(answer["data"])

    def picture(self) -> bytes:
        """The whole page as PNG."""
        answer = self._send("Page.captureScreenshot", captureBeyondViewport=True)
        return base64.b64decode(answer["data"])

    def _send(self, method: str, **params: Any) -> Any:
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + PATIENCE
        while True:
            answer = self._receive(until)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]
            if answer.get("method") in ("Runtime.consoleAPICalled", "Log.entryAdded"):
                self.console.append(json.dumps(answer["params"]))

    def _receive(self, until: float) -> Any:
        while b"\0" not in self._left:
            if not select.select([self._read], [], [], max(0.0, until - time.monotonic()))[0]:
                raise AssertionError(f"chromium did not answer in {PATIENCE} s")
            part = os.read(self._read, 1 << 20)
            if not part:
                raise AssertionError("chromium ended")
            self._left += part
        message, _, self._left = self._left.partition(b"\0")
        return json.loads(message)


KEYS = {
    "ArrowLeft": {"windowsVirtualKeyCode": 37},
    "ArrowRight": {"windowsVirtualKeyCode": 39},
    "Tab": {"windowsVirtualKeyCode": 9},
    " ": {"windowsVirtualKeyCode": 32, "text": " "},
}


@contextmanager
def open_browser() -> Iterator[Browser]:
    """A browser that ends with the block; a test is skipped where there is no Chromium."""
    if CHROMIUM is None:
        pytest.skip("there is no chromium here (Debian: apt-get install chromium)")
    to_it, from_it = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:

        def wire() -> None:  # it reads commands at 3 and answers at 4
            os.dup2(to_it[0], 103)
            os.dup2(from_it[1], 104)
            os.dup2(103, 3)
            os.dup2(104, 4)

        process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=wire,
            close_fds=False,
        )
        try:
            os.close(to_it[0])
            os.close(from_it[1])
            yield Browser(to_it[1], from_it[0])
        finally:
            process.terminate()
            process.wait(20)
            os.close(to_it[1])
            os.close(from_it[0])


@dataclass(frozen=True)
class Seen:
    """What a page showed: `look` and `useAll` of look.js, what was logged, and its HTML then."""

    look: dict[str, Any]
    used: dict[str, Any]
    console: list[str]
    html: str


def look_at(browser: Browser, page: Path, width: int) -> Seen:
    """Open a page in a window of some width, look at all of it and use every control."""
    browser.open(page, width)
    browser.ask(f"{LOOK};0")
    look = browser.ask("cosimTest.look()")
    used = browser.ask("cosimTest.useAll()")
    html = browser.ask("document.documentElement.outerHTML")
    return Seen(look, used, [x for x in browser.console if not re.search(SLOW, x)], html)


def check_look(seen: Seen) -> None:
    """Nothing is cut, covered, without a name or out of reach, every control does something, and
    nothing went wrong."""
    wrong = ("errors", "asked", "cut", "overlaps", "nameless", "unseenFocus", "empty", "outside")
    faults = {key: seen.look[key] for key in wrong if seen.look.get(key)}
    assert faults == {}, faults
    assert seen.look["fits"] is True
    assert seen.used["idle"] == seen.used["errors"] == []
    assert [x for x in seen.console if re.search(r"rror|ncaught|ailed|efused|arning|WARN", x)] == []
    for title, drawn, wanted in seen.look.get("charts", []):
        assert drawn == wanted > 0, title
