"""A page in headless Chromium, driven through its debugging protocol."""

import base64
import contextlib
import json
import socket
import subprocess
import time
import urllib.request

import cv2
import numpy as np
import pytest

from dsmap.classes import PALETTE


class Page:
    """A page of a browser, driven through its debugging protocol."""

    def __init__(self, socket_) -> None:
        self.socket = socket_
        self.count = 0

    def call(self, method: str, **params):
        self.count += 1
        self.socket.send(json.dumps({"id": self.count, "method": method, "params": params}))
        while (answer := json.loads(self.socket.recv(timeout=60))).get("id") != self.count:
            pass
        return answer["result"]

    def text(self) -> str:
        return self.call("Runtime.evaluate", expression="document.body?.innerText ?? ''")["result"]["value"]

    def click(self, words: str) -> None:
        """Switch the checkbox beside the words."""
        script = """[...document.querySelectorAll("input[type=checkbox]")].find((box) => {
            for (let node = box, i = 0; i < 8; i++, node = node.parentElement)
                if (node.innerText?.trim() === "%s") return true;
        }).click()"""
        answer = self.call("Runtime.evaluate", expression=script % words)
        assert "exceptionDetails" not in answer, f"the page has no switch {words!r}"

    def press(self, words: str) -> None:
        """Press the button of this name."""
        script = (
            """[...document.querySelectorAll("button")].find((b) => b.innerText.trim() === "%s").click()"""
        )
        answer = self.call("Runtime.evaluate", expression=script % words)
        assert "exceptionDetails" not in answer, f"the page has no button {words!r}"

    def share(self, label: int) -> float:
        """Share of the screen that has nearly the colour of a class."""
        png = base64.b64decode(self.call("Page.captureScreenshot")["data"])
        image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
        return float((np.abs(image - PALETTE[label]).max(axis=2) < 12).mean())


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait(check, seconds: float = 60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if (result := check()) is not None:
            return result
        time.sleep(0.3)
    pytest.fail(f"nothing happened in {seconds} s")


@contextlib.contextmanager
def browser(chromium: str, folder, url: str):
    """A page in headless Chromium with WebGL in software."""
    from websockets.sync.client import connect

    debug = free_port()
    flags = (
        "--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking "
        "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader "
        f"--enable-unsafe-swiftshader --window-size=900,600 --remote-debugging-port={debug}"
    ).split()
    command = [chromium, *flags, f"--user-data-dir={folder / 'profile'}", url]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def address() -> str | None:
        with contextlib.suppress(OSError):
            tabs = json.load(urllib.request.urlopen(f"http://127.0.0.1:{debug}/json"))
            return next((tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page"), None)
        return None

    try:
        with connect(wait(address), max_size=None) as socket_:
            yield Page(socket_)
    finally:
        process.terminate()
        process.wait(timeout=30)
