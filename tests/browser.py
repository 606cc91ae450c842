"""Chromium, driven over its DevTools protocol: opens pages, evaluates script in them, takes pictures of them."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import connect

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
_WAIT_S = 30.0


class Tab:
    """One page."""

    def __init__(self, address: str) -> None:
        self._socket, self._numbers = connect(address, max_size=None).__enter__(), itertools.count(1)
        self.call("Page.enable")
        self.call("Runtime.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the protocol, and its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._socket.recv(_WAIT_S))).get("id") != number:
            pass
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def reload(self) -> None:
        self.call("Page.reload")

    def size(self, width: int, height: int) -> None:
        """Of the window, as on a phone where it is narrow."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
        )

    def eval(self, script: str) -> Any:
        """The value of an expression."""
        told = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def until(self, script: str, timeout_s: float = _WAIT_S) -> Any:
        """The value of an expression once it is true."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            with contextlib.suppress(AssertionError):  # the page is loading
                if value := self.eval(script):
                    return value
            time.sleep(0.05)
        raise AssertionError(f"never true: {script}; the page says {self.eval('document.body.innerText')}")

    def click(self, selector: str) -> None:
        self.eval(f"document.querySelector({json.dumps(selector)}).click()")

    def text(self, selector: str) -> str:
        return str(self.eval(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    def picture(self, file: Path) -> None:
        """Save what is seen, as PNG."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))


class Browser:
    """A browser that runs."""

    def __init__(self, port: int) -> None:
        self._port = port

    def tab(self, url: str = "about:blank") -> Tab:
        """A new page."""
        with urlopen(f"http://127.0.0.1:{self._port}/json/version", timeout=_WAIT_S) as answer:
            main = Tab.__new__(Tab)
            main._socket = connect(json.load(answer)["webSocketDebuggerUrl"], max_size=None).__enter__()
            main._numbers = itertools.count(1)
        target = main.call("Target.createTarget", url="about:blank")["targetId"]
        tab = Tab(f"ws://127.0.0.1:{self._port}/devtools/page/{target}")
        tab.size(1280, 900)
        if url != "about:blank":
            tab.open(url)
        return tab


@contextlib.contextmanager
def browser(folder: Path) -> Iterator[Browser]:
    """Chromium with a profile in `folder`."""
    profile = folder / "profile"
    command = [str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
    command += ["--remote-allow-origins=*", f"--user-data-dir={profile}", "--no-first-run", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        file, end = profile / "DevToolsActivePort", time.monotonic() + _WAIT_S
        while not (file.exists() and "\n" in (written := file.read_text())):
            assert time.monotonic() < end, "Chromium did not start"
            time.sleep(0.05)
        yield Browser(int(written.splitlines()[0]))
    finally:
        process.terminate()
        process.wait(_WAIT_S)
