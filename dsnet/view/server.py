"""The viewer's server: its page, what the page loads, and what it asks of `Application`.

It answers this machine alone, at an address with a random part that `dsnet view` prints, and only
requests of its own page: a page of another site can neither guess the address nor send to it.
"""

from __future__ import annotations

import json
import secrets
import shutil
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import quote, unquote

from bridge.errors import DsnetError
from dsnet.view.application import Application
from dsnet.view.page import document

HOST = "127.0.0.1"
_CACHED_ASSETS = 16
"""Of 50 MB each at most: two motions with four tracks each, besides what every page needs."""
_LONGEST_REQUEST = 1 << 16
"""Bytes of a request that is no motion file."""
_LOADED_FIRST = ("scene", "runtime", "model")


@contextmanager
def serving(application: Application, port: int) -> Iterator[str]:
    """Serve the page while the block runs, and give its address; port 0 takes any that is free."""
    try:
        server = _Server(application, port)
    except OSError as error:
        raise DsnetError(
            f"--port {port}, where nothing can be served ({error.strerror})",
            "a free port",
            "Pass --port 0 for any free port, or end what serves there.",
        ) from error
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/{server.token}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, application: Application, port: int) -> None:
        super().__init__((HOST, port), _Handler)
        self.application, self.token = application, secrets.token_urlsafe(16)
        self.page = document().encode()
        # A lock for each, so that two tabs do not make the same asset at a time.
        self._locks: defaultdict[Callable[[], bytes], threading.Lock] = defaultdict(threading.Lock)
        self._cached = lru_cache(_CACHED_ASSETS)(lambda make: make())
        for name in {*_LOADED_FIRST} & set(application.scenes[0].assets):
            self.asset(0, name)

    def asset(self, scene: int, name: str) -> bytes:
        make = self.application.scenes[scene].assets[name]
        with self._locks[make]:
            return self._cached(make)


_REQUESTS: dict[str, Callable[[Application, dict[str, Any]], Any]] = {
    "read": lambda one, asked: one.read_again(asked["scene"], asked["number"], asked["reading"]),
    "shape": lambda one, asked: one.shape(asked["scene"], asked["words"]),
    "export": lambda one, asked: one.export(**asked),
    "cancel": lambda one, asked: one.end_export(),
}


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        match self._path():
            case [""]:
                self._send(self.server.page, "text/html; charset=utf-8")
            case ["assets", number, name]:
                with self._refused():
                    self._send(self.server.asset(int(number), name), "application/octet-stream")
            case ["formats"]:
                self._answer(self.server.application.formats)
            case ["export", "state"]:
                self._answer(self.server.application.export_state)
            case ["export", "file"]:
                self._send_export()
            case _:
                self.send_error(404, explain="The page is at the whole address that was printed.")

    def do_POST(self) -> None:
        application, path = self.server.application, self._path()
        size = int(self.headers.get("Content-Length") or 0)
        match path:
            case _ if self.headers.get("Origin") not in self._origins():
                self.send_error(403)
            case ["files", name]:
                self._answer(lambda: application.receive(unquote(name), self.rfile, size))
            case [name] if name in _REQUESTS and size <= _LONGEST_REQUEST:
                asked = self.rfile.read(size)
                self._answer(lambda: _REQUESTS[name](application, json.loads(asked)))
            case _:
                self.send_error(404)

    def _path(self) -> list[str]:
        """Parts of the path below the token; none if the request is not our page's.

        Other host names are refused, as a foreign site could point its own at this address.
        """
        token, *parts = self.path.lstrip("/").split("/")
        is_ours = secrets.compare_digest(token.encode(), self.server.token.encode())
        is_ours &= f"http://{self.headers.get('Host')}" in self._origins()
        return parts if is_ours else []

    def _origins(self) -> list[str]:
        return [f"http://{name}:{self.server.server_port}" for name in (HOST, "localhost")]

    def _answer(self, answer: Callable[[], Any]) -> None:
        with self._refused():
            self._send(json.dumps(answer()).encode(), "application/json")

    @contextmanager
    def _refused(self) -> Iterator[None]:
        """A mistake of the user's is a line for the page; one of the request is an error."""
        try:
            yield
        except DsnetError as error:
            self._send(json.dumps({"failed": str(error)}).encode(), "application/json")
        except (KeyError, IndexError, TypeError, ValueError):
            self.send_error(400)

    def _send(self, body: bytes, kind: str) -> None:
        self._head(len(body), kind)
        with suppress(ConnectionError):  # the tab was closed
            self.wfile.write(body)

    def _send_export(self) -> None:
        job = self.server.application.job
        if job is None or job.file is None:
            self.send_error(404)
            return
        with job.file.open("rb") as file:
            name = f"attachment; filename*=UTF-8''{quote(job.file.name)}"
            self._head(job.file.stat().st_size, "application/octet-stream", name)
            with suppress(ConnectionError):
                shutil.copyfileobj(file, self.wfile)

    def _head(self, size: int, kind: str, disposition: str | None = None) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(size))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        if disposition:
            self.send_header("Content-Disposition", disposition)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Do not log requests."""
