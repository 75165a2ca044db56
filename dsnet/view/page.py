"""The viewer's page: as one HTML file that holds its assets, or from a server that makes them.

Its sources are in `web/`; `npm ci && npm run build` there writes `bundle/`, which is shipped.
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
from dsnet.exporters.output import facts_in_a_line
from dsnet.prediction.moving_body import MovingBody
from dsnet.view.clip_list import ClipList, clip_of, path_title
from dsnet.view.scene import BUNDLE, Scene

HOST = "127.0.0.1"
_CACHED_ASSETS = 16
"""Of 50 MB each at most: two motions with four tracks each, besides what every page needs."""
_GZIP_MAGIC, _GZIP_LEVEL = b"\x1f\x8b", 6


def document(scene: Scene | None = None, about: str = "") -> str:
    """HTML that holds a scene and needs no network; without a scene it loads `assets/`.

    `about` becomes the page's description.
    """
    page = (BUNDLE / "page.html").read_text(encoding="utf-8")
    assets = {} if scene is None else scene.assets
    embedded = "\n".join(
        f'<script type="text/plain" id="asset:{name}">'
        f"{base64.b64encode(_compressed(make())).decode('ascii')}</script>"
        for name, make in assets.items()
    )
    before, after = page.split("<!--assets-->")
    before = before.replace("@CONNECT@", "'self'" if scene is None else "'none'")
    return before.replace("@ABOUT@", html.escape(about)) + embedded + after


def _compressed(asset: bytes) -> bytes:
    return asset if asset.startswith(_GZIP_MAGIC) else gzip.compress(asset, _GZIP_LEVEL, mtime=0)


def write(path: Path, moving: MovingBody, *others: MovingBody) -> None:
    """Write a moving body as one HTML file that plays in any browser, without a network.

    `others` are the same body and motion by other predictors.
    """
    trained = {one.trained.name: one.trained for one in (moving, *others)}
    clip, truth = clip_of(moving)
    clip_list = ClipList(
        moving.trained,
        predictors={name: one.label for name, one in trained.items()},
        open=trained.__getitem__,
        clips={path_title(moving.motion.source): clip},
        truth=truth,
    )
    text = document(
        Scene(clip_list, moving.controls, moving.loop), facts_in_a_line(moving, *others)
    )
    path.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def serving(scene: Scene, port: int) -> Iterator[str]:
    """Serve the page while the block runs, and give its address; port 0 takes any that is free."""
    page = document().encode()
    # A lock for each, so that two tabs do not make the same asset at a time.
    locks = {name: threading.Lock() for name in scene.assets}
    cached_asset = lru_cache(_CACHED_ASSETS)(lambda name: scene.assets[name]())
    for name in {"scene", "runtime", "model"} & set(locks):  # what every page loads first
        cached_asset(name)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = self.path.removeprefix("/assets/")
            # Refuse other host names: a foreign site could point its own at this address.
            if self.headers.get("Host") not in (f"{HOST}:{bound_port}", f"localhost:{bound_port}"):
                self.send_error(403)
            elif self.path == "/":
                self._send(page, "text/html; charset=utf-8")
            elif name in locks:
                try:
                    with locks[name]:
                        asset = cached_asset(name)
                except DsnetError as error:
                    self._send(json.dumps({"failed": str(error)}).encode(), "application/json")
                    return
                self._send(asset, "application/octet-stream")
            else:
                self.send_error(404)

        def _send(self, body: bytes, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            with suppress(ConnectionError):  # the tab was closed
                self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Do not log requests."""

    try:
        server = ThreadingHTTPServer((HOST, port), Handler)
    except OSError as error:
        raise DsnetError(
            f"--port {port}, where nothing can be served ({error.strerror})",
            "a free port",
            "Pass --port 0 for any free port, or end what serves there.",
        ) from error
    server.daemon_threads = True
    bound_port = server.server_address[1]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{bound_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
