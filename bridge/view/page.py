"""The page as a document, which holds what it shows or asks its server for it.

`web/` has its sources; `npm ci && npm run build` there writes `bundle/`, which is shipped.
"""

from __future__ import annotations

import base64
import gzip
import html
from importlib import resources
from pathlib import Path

from bridge.view.scene import Scene

BUNDLE = Path(str(resources.files("bridge.view"))) / "bundle"
_LEVEL = 6


def document(scene: Scene | None = None, about: str = "") -> str:
    """HTML that shows a scene from a disk, without a network; without one it asks for `assets/`.

    `about` is a line on what is shown.
    """
    page = (BUNDLE / "page.html").read_text(encoding="utf-8")
    names = [] if scene is None else ["runtime", *scene.assets]
    embedded = "\n".join(
        f'<script type="text/plain" id="asset:{name}">'
        f"{base64.b64encode(packed(scene, name)).decode('ascii')}</script>"
        for name in names
        if scene is not None
    )
    before, after = page.split("<!--assets-->")
    before = before.replace("@CONNECT@", "'self'" if scene is None else "'none'")
    return before.replace("@ABOUT@", html.escape(about)) + embedded + after


def raw(scene: Scene, name: str) -> bytes:
    """An asset's bytes; `runtime`, which is kept packed by gzip, is what runs graphs."""
    return (BUNDLE / "runtime.wasm.gz").read_bytes() if name == "runtime" else scene.assets[name]()


def packed(scene: Scene, name: str) -> bytes:
    """The same, packed."""
    found = raw(scene, name)
    return found if name == "runtime" else gzip.compress(found, _LEVEL, mtime=0)
