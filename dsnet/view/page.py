"""The page as a document that holds what it shows, or from a server, which makes that when the page
asks for it.

`web/` has its sources; `npm ci && npm run build` there writes `bundle/`, which is shipped.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from bridge.errors import DsnetError
from dsnet.exporters.output import about_in_a_line
from dsnet.prediction.moving_body import MovingBody
from dsnet.view.clip_list import Repertoire, path_title, take_of
from dsnet.view.scene import BUNDLE, Scene

HOST = "127.0.0.1"
_KEPT = 16
"""Assets, of 50 MB each at most: two motions with four tracks each, beside what every page has."""
_GZIP, _LEVEL = b"\x1f\x8b", 6


def document(scene: Scene | None = None, about: str = "") -> str:
    """HTML that shows a scene from a disk, without a network; without one it asks for `assets/`.

    `about` is a line on what is shown.
    """
    page = (BUNDLE / "page.html").read_text(encoding="utf-8")
    assets = {} if scene is None else scene.assets
    embedded = "\n".join(
        f'<script type="text/plain" id="asset:{name}">'
        f"{base64.b64encode(_packed(made())).decode('ascii')}</script>"
        for name, made in assets.items()
    )
    before, after = page.split("<!--assets-->")
    before = before.replace("@CONNECT@", "'self'" if scene is None else "'none'")
    return before.replace("@ABOUT@", html.escape(about)) + embedded + after


def _packed(found: bytes) -> bytes:
    return found if found.startswith(_GZIP) else gzip.compress(found, _LEVEL, mtime=0)


def write(path: Path, moving: MovingBody, *beside: MovingBody) -> None:
    """A moving body as one page that plays in any browser, without a network.

    `beside` is what other predictors make of the same motion.
    """
    trained = {one.trained.name: one.trained for one in (moving, *beside)}
    take, truth = take_of(moving)
    repertoire = Repertoire(
        moving.trained,
        predictors={name: one.label for name, one in trained.items()},
        open=trained.__getitem__,
        takes={path_title(moving.motion.source): take},
        truth=truth,
    )
    text = document(
        Scene(repertoire, moving.controls, moving.loop), about_in_a_line(moving, *beside)
    )
    path.write_text(text, encoding="utf-8", newline="\n")


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
