"""Drives Chromium without a screen by its DevTools protocol over a pipe."""

import base64
import contextlib
import fcntl
import itertools
import json
import os
import subprocess
import time

from helpers import needs_debian

_FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--hide-scrollbars"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    "--remote-debugging-pipe",
]
# No name is resolved, so that a request to a host fails and is seen.
_NO_HOSTS = "--host-resolver-rules=MAP * ~NOTFOUND"


class Chromium:
    """A browser with one page. Use it as a context manager.

    Attributes:
        events: Events of the page since it was opened: (method, parameters).
    """

    def __init__(self, folder):
        needs_debian("chromium")
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in _pipes()]
        theirs_in, self._commands, self._answers, theirs_out = ends
        # The browser reads commands from its descriptor 3 and writes to 4.
        script = f'exec chromium "$@" 3<&{theirs_in} 4>&{theirs_out}'
        flags = [*_FLAGS, _NO_HOSTS, f"--user-data-dir={folder}/profile"]
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", *flags],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(theirs_in, theirs_out),
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._buffer = b""
        self._ids = itertools.count(1)
        self._session = None
        self.events = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._commands)
        os.close(self._answers)

    def send(self, method, **parameters):
        """Send a command, and return its result."""
        message = {"id": next(self._ids), "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == message["id"]:
                assert "error" not in answer, answer
                return answer["result"]
            if "method" in answer:
                self.events.append((answer["method"], answer["params"]))

    def _receive(self):
        while b"\0" not in self._buffer:
            data = os.read(self._answers, 1 << 20)
            assert data, "Chromium has ended"
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)

    def open(
        self, url, width=1280, height=900, dark=False, before="", ready="window.replay"
    ):
        """Open a page, and wait until it is ready; `before` that, run a script."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            **{"width": width, "height": height, "deviceScaleFactor": 1},
            mobile=False,
        )
        scheme = "dark" if dark else "light"
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.send("Emulation.setEmulatedMedia", features=features)
        self.send("Page.navigate", url="about:blank")
        self.events.clear()
        add, remove = (
            f"Page.{verb}ScriptToEvaluateOnNewDocument" for verb in ("add", "remove")
        )
        script = self.send(add, source=before)["identifier"]
        self.send("Page.navigate", url=url)
        self.send(remove, identifier=script)
        self.wait_for(ready)

    def evaluate(self, expression):
        """Return the value of an expression of the page."""
        result = self.send(
            "Runtime.evaluate",
            expression=expression,
            returnByValue=True,
            awaitPromise=True,
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait_for(self, condition):
        """Wait until an expression of the page is true."""
        for _ in range(400):
            if self.evaluate(f"Boolean({condition})"):
                return
            time.sleep(0.05)
        raise AssertionError(f"never true: {condition}; {self.complaints()}")

    def press(self, key):
        """Press and release a key."""
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key)

    def drag(self, start, end):
        """Press the mouse at a point, move it to another, and release it."""
        for kind, (x, y), buttons in (
            ("mousePressed", start, 1),
            ("mouseMoved", end, 1),
            ("mouseReleased", end, 0),
        ):
            self.send(
                "Input.dispatchMouseEvent",
                **{"type": kind, "x": x, "y": y, "buttons": buttons},
                button="left",
                clickCount=1,
            )

    def screenshot(self):
        """Return the picture of the page as PNG."""
        shot = self.send("Page.captureScreenshot", captureBeyondViewport=True)
        return base64.b64decode(shot["data"])

    def complaints(self):
        """Return errors and warnings that the page caused since it was opened."""
        found = []
        for method, parameters in self.events:
            if method == "Runtime.exceptionThrown":
                found.append(parameters["exceptionDetails"])
            elif method == "Log.entryAdded":
                text = parameters["entry"]["text"]
                # About the driver: screenshots are slow.
                if "GL Driver Message (OpenGL, Performance" not in text:
                    found.append(text)
            elif method == "Runtime.consoleAPICalled":
                found.append(parameters["args"])
        return found

    def requests(self):
        """Return the addresses that were requested since the page was opened.

        What the page's own policy refuses never leaves the browser.
        """
        refused = {
            parameters["requestId"]
            for method, parameters in self.events
            if method == "Network.loadingFailed"
            and parameters.get("blockedReason") == "csp"
        }
        return [
            parameters["request"]["url"]
            for method, parameters in self.events
            if method == "Network.requestWillBeSent"
            and parameters["requestId"] not in refused
            and not parameters["request"]["url"].startswith(("data:", "about:"))
        ]


def _pipes():
    """Return the ends of two pipes: read, write, read, write; they close themselves."""
    with contextlib.ExitStack() as stack:
        ends = [*os.pipe(), *os.pipe()]
        for end in ends:
            stack.callback(os.close, end)
        yield from ends
