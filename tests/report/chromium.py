"""A headless Chromium, driven over its debugging pipe: no driver, no package, no port.

Protocol: https://chromedevtools.github.io/devtools-protocol/ (JSON messages that end with NUL, on
file descriptors 3 and 4 of the browser).
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TIMEOUT = 180.0
_NAVIGATED = "target navigated"
"""In what Chromium answers where a script's document has been left for another."""


def find_chromium() -> str | None:
    """Path of an installed Chromium, or None."""
    named = os.environ.get("CHROMIUM")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


class Navigated(AssertionError):
    """The document in which a script ran is gone."""


class Page:
    """One tab: runs scripts, takes screenshots, remembers requests and complaints."""

    def __init__(self, browser: Browser, session: str, target: str) -> None:
        self.browser = browser
        self.session = session
        self.target = target
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.loaded: set[str] = set()

    def send(self, method: str, **params: Any) -> Any:
        return self.browser.send(method, params, self.session)

    def event(self, method: str, params: dict[str, Any]) -> None:
        match method:
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])
            case "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                thrown = details.get("exception", {}).get("description", "")
                self.complaints.append(f"{details['text']} {thrown}")
            case "Runtime.consoleAPICalled" if params["type"] in ("error", "warning", "assert"):
                self.complaints.append(str([a.get("value") for a in params["args"]]))
            case "Log.entryAdded" if params["entry"]["level"] in ("error", "warning"):
                self.complaints.append(params["entry"]["text"])
            case "Page.lifecycleEvent" if params["name"] == "load":
                self.loaded.add(params["loaderId"])
            case _:
                pass

    def open(self, path: Path, fragment: str = "") -> Page:
        """Load a file as a new document and wait until it is there."""
        self._load("about:blank")
        self.requests.clear()
        self._load(path.resolve().as_uri() + fragment)
        return self

    def visit(self, url: str) -> Page:
        """Load an address as a new document and wait until it is there."""
        self.requests.clear()
        self._load(url)
        return self

    def _load(self, url: str) -> None:
        loader = self.send("Page.navigate", url=url)["loaderId"]
        self.browser.pump(lambda: loader in self.loaded)

    def run(self, script: str) -> Any:
        """Return the value of an expression; awaits a promise."""
        answer = self.send(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait(self, condition: str, timeout: float = TIMEOUT) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + timeout
        while not self._is_true(condition):
            if time.monotonic() > end:
                raise AssertionError(f"in {timeout:g} s it did not come true: {condition}")
            time.sleep(0.05)

    def _is_true(self, condition: str) -> bool:
        """Whether an expression is true; not while one document gives way to the next."""
        try:
            return bool(self.run(f"!!({condition})"))
        except Navigated:
            return False

    def emulate(
        self,
        width: int,
        height: int = 900,
        *,
        scale: float = 1.0,
        scheme: str = "light",
        media: str = "",
    ) -> None:
        """Set the size of the viewport, the colour scheme and the medium."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.send("Emulation.setEmulatedMedia", media=media, features=features)

    def key(self, key: str) -> None:
        """Press and release a key, by its name or character."""
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent", type=kind, key=key, **(text if kind == "keyDown" else {})
            )

    def mouse(self, kind: str, x: float, y: float, **params: Any) -> None:
        """Dispatch mousePressed, mouseMoved or mouseReleased at a point of the viewport."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **params)

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        """Dispatch touchStart, touchMove or touchEnd with the fingers that are down."""
        fingers = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)]
        self.send("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        """Drag with the left button held."""
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        middle = ((start[0] + stop[0]) / 2, (start[1] + stop[1]) / 2)
        for point in (middle, stop):
            self.mouse("mouseMoved", *point, button="left", buttons=1)
            time.sleep(0.05)
        self.mouse("mouseReleased", *stop, button="left", clickCount=1)

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Save what is seen, or the whole page, as PNG."""
        params: dict[str, Any] = {"format": "png"}
        if whole:
            size = self.send("Page.getLayoutMetrics")["cssContentSize"]
            clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
            params |= {"captureBeyondViewport": True, "clip": clip}
        path.write_bytes(base64.b64decode(self.send("Page.captureScreenshot", **params)["data"]))

    def pdf(self, path: Path) -> None:
        """Print the page."""
        path.write_bytes(base64.b64decode(self.send("Page.printToPDF")["data"]))

    def heap(self) -> int:
        """Bytes of JavaScript in use after collecting garbage."""
        self.send("HeapProfiler.collectGarbage")
        return int(self.send("Runtime.getHeapUsage")["usedSize"])

    def close(self) -> None:
        self.browser.send("Target.closeTarget", {"targetId": self.target})


class Browser:
    """A Chromium with a fresh profile; ends with its `with` block."""

    def __init__(self, executable: str, timeout: float = TIMEOUT) -> None:
        self.timeout = timeout
        self._profile = tempfile.mkdtemp(prefix="chromium-")
        reads, self._out = os.pipe()
        self._in, writes = os.pipe()
        options = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--disable-default-apps", "--no-first-run", "--mute-audio", "--hide-scrollbars",
            "--remote-debugging-pipe", f"--user-data-dir={self._profile}", "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$0" "$@" 3<&{reads} 4>&{writes}', executable, *options],
            pass_fds=(reads, writes),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(reads)
        os.close(writes)
        self._number = 0
        self._buffer = b""
        self._answers: dict[int, dict[str, Any]] = {}
        self._pages: dict[str, Page] = {}

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def page(self, script: str = "") -> Page:
        """Open a tab; `script` runs before those of any document."""
        target = self.send("Target.createTarget", {"url": "about:blank"})["targetId"]
        attach = {"targetId": target, "flatten": True}
        session = self.send("Target.attachToTarget", attach)["sessionId"]
        page = Page(self, session, target)
        self._pages[session] = page
        for domain in ("Page", "Runtime", "Network", "Log"):
            page.send(f"{domain}.enable")
        page.send("Page.setLifecycleEventsEnabled", enabled=True)
        if script:
            page.send("Page.addScriptToEvaluateOnNewDocument", source=script)
        page.emulate(1280)
        return page

    def send(self, method: str, params: dict[str, Any], session: str = "") -> Any:
        """Send a command and return its result."""
        self._number += 1
        number = self._number
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        self.pump(lambda: number in self._answers)
        answer = self._answers.pop(number)
        if "error" in answer:
            kind = Navigated if _NAVIGATED in answer["error"]["message"] else AssertionError
            raise kind(f"{method}: {answer['error']}")
        return answer["result"]

    def pump(self, done: Any) -> None:
        """Read messages until `done()`."""
        end = time.monotonic() + self.timeout
        while not done():
            while b"\0" in self._buffer:
                raw, _, self._buffer = self._buffer.partition(b"\0")
                self._take(json.loads(raw))
                if done():
                    return
            ready, _, _ = select.select([self._in], [], [], 0.5)
            if ready:
                read = os.read(self._in, 1 << 20)
                if not read:
                    raise AssertionError("Chromium ended")
                self._buffer += read
            elif time.monotonic() > end:
                raise AssertionError(f"Chromium did not answer in {self.timeout:g} s")

    def _take(self, message: dict[str, Any]) -> None:
        if "id" in message:
            self._answers[message["id"]] = message
        elif page := self._pages.get(message.get("sessionId", "")):
            page.event(message["method"], message["params"])

    def close(self) -> None:
        """End the browser and forget its profile."""
        try:
            self.send("Browser.close", {})
        except (AssertionError, OSError):
            self._process.kill()
        for descriptor in (self._in, self._out):
            os.close(descriptor)
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        shutil.rmtree(self._profile, ignore_errors=True)
