"""Serves a page to this machine alone; what it shows is made when the page asks for it."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from bridge.errors import DsnetError
from bridge.view.page import document
from bridge.view.scene import Scene

HOST = "127.0.0.1"
_KEPT = 8
"""Assets, of some 10 MB each at most."""


@contextmanager
def serving(scene: Scene, port: int) -> Iterator[str]:
    """The page's address while the block runs; port 0 takes any that is free."""
    page = document().encode()
    # Made once, also where two tabs ask at a time; not packed, as nothing is near.
    alone = {name: threading.Lock() for name in scene.assets}
    kept = lru_cache(_KEPT)(lambda name: scene.assets[name]())
    for name in {"scene", "runtime", "model"} & set(alone):  # what every page asks for first
        kept(name)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = self.path.removeprefix("/assets/")
            # A page of somebody else's that has this address under its own name gets nothing.
            if self.headers.get("Host") not in (f"{HOST}:{at}", f"localhost:{at}"):
                self.send_error(403)
            elif self.path == "/":
                self._send(page, "text/html; charset=utf-8")
            elif name in alone:
                try:
                    with alone[name]:
                        found = kept(name)
                except DsnetError as error:
                    self._send(json.dumps({"failed": str(error)}).encode(), "application/json")
                    return
                self._send(found, "application/octet-stream")
            else:
                self.send_error(404)

        def _send(self, body: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            with suppress(ConnectionError):  # a tab that was closed
                self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Nothing."""

    try:
        server = ThreadingHTTPServer((HOST, port), Handler)
    except OSError as error:
        raise DsnetError(
            f"--port {port}, where nothing can be served ({error.strerror})",
            "a free port",
            "Pass --port 0 for any free port, or end what serves there.",
        ) from error
    server.daemon_threads = True
    at = server.server_address[1]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{at}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
