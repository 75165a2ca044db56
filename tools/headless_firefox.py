"""Firefox on a virtual screen, driven by WebDriver BiDi: for tests.

Playwright's Firefox is one of its own making; this is the one that is installed. Without a screen
Firefox draws no WebGL, so it is given one that nobody sees.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from websockets.sync.connection import Connection

PATIENCE_S = 120
"""A machine without a graphics card, busy with other work, draws a picture in many seconds."""
_QUIET = {
    "app.normandy.enabled": False,
    "app.update.enabled": False,
    "browser.aboutwelcome.enabled": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "network.captive-portal-service.enabled": False,
    "services.settings.server": "data:,",
    "webgl.force-enabled": True,
}


def why_missing() -> str | None:
    """What is not installed, or None if a browser can be started."""
    if importlib.util.find_spec("websockets") is None:
        return "websockets is not installed: pip install websockets"
    for program, package in (("firefox", "firefox-esr"), ("Xvfb", "xvfb")):
        if shutil.which(program) is None:
            return f"{program} is not installed: apt-get install {package}"
    return None


class FirefoxPage:
    """The one page of a browser; methods of Playwright's name do what Playwright's do."""

    def __init__(self, socket: Connection) -> None:
        self._socket, self._numbers = socket, count()
        self.errors: list[str] = []
        """Errors on its console, and exceptions that nobody caught."""
        self._send("session.new", capabilities={})
        self._send("session.subscribe", events=["log.entryAdded"])
        self._context = self._send("browsingContext.getTree")["contexts"][0]["context"]

    def goto(self, address: str) -> None:
        """Open an address."""
        self._send("browsingContext.navigate", context=self._context, url=address, wait="complete")

    def evaluate(self, script: str, given: Any = None) -> Any:
        """What an expression, or a function of what is given, comes to; both as JSON."""
        called = f"typeof it === 'function' ? it({json.dumps(given)}) : it"
        found = self._send(
            "script.evaluate",
            expression=f"(async () => {{ const it = ({script}); return JSON.stringify(await ({called})); }})()",  # noqa: E501
            target={"context": self._context},
            awaitPromise=True,
        )
        if found["type"] == "exception":
            raise RuntimeError(found["exceptionDetails"]["text"])
        return json.loads(found["result"].get("value", "null"))

    def wait_for_selector(self, selector: str, state: str = "attached") -> None:
        """Wait until an element is there."""
        assert state == "attached", state
        end_s = time.monotonic() + PATIENCE_S
        while not self.evaluate(f"document.querySelector({json.dumps(selector)}) !== null"):
            assert time.monotonic() < end_s, f"waited in vain for {selector}; {self.errors}"
            time.sleep(0.1)

    def inner_text(self, selector: str) -> str:
        """What an element says."""
        return self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")

    def set_input_files(self, selector: str, path: str) -> None:
        """Choose a file."""
        found = self._send(
            "script.evaluate",
            expression=f"document.querySelector({json.dumps(selector)})",
            target={"context": self._context},
            awaitPromise=False,
        )
        element = {"sharedId": found["result"]["sharedId"]}
        self._send("input.setFiles", context=self._context, element=element, files=[path])

    def _send(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._socket.recv(PATIENCE_S))).get("id") != number:
            entry = answer.get("params", {})
            if entry.get("level") == "error":
                self.errors.append(entry["text"])
        if answer["type"] == "error":
            raise RuntimeError(f"{method}: {answer['message']}")
        return answer["result"]


@contextmanager
def firefox() -> Iterator[FirefoxPage]:
    """A browser with one page, and a screen for it; both end with the block."""
    from websockets.sync.client import connect

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name, _screen() as display:
        profile, log = Path(name), Path(name) / "log"
        lines = [f"user_pref({json.dumps(k)}, {json.dumps(v)});\n" for k, v in _QUIET.items()]
        (profile / "user.js").write_text("".join(lines), encoding="utf-8")
        command = ["firefox", "--no-remote", "--remote-debugging-port", "0", "--profile", name]
        environment = {**os.environ, "DISPLAY": f":{display}"}
        with (
            log.open("w", encoding="utf-8") as stream,
            _running(command, env=environment, stderr=stream) as browser,
            connect(f"{_address(browser, log)}/session", max_size=None, proxy=None) as socket,
        ):
            yield FirefoxPage(socket)


@contextmanager
def _screen() -> Iterator[int]:
    """Number of a display that nobody sees."""
    size = ("-screen", "0", "1280x1024x24")
    command = ["Xvfb", "-displayfd", "1", *size]
    with _running(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as screen:
        assert screen.stdout is not None
        yield int(screen.stdout.readline())


def _address(browser: subprocess.Popen[str], log: Path) -> str:
    end_s = time.monotonic() + PATIENCE_S
    while not (found := re.search(r"BiDi listening on (ws://\S+)", _text(log))):
        if browser.poll() is not None or time.monotonic() > end_s:
            raise RuntimeError(f"Firefox did not listen: {_text(log)}")
        time.sleep(0.1)
    return found[1]


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@contextmanager
def _running(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(command, text=True, **options) as process:
        try:
            yield process
        finally:
            process.terminate()
