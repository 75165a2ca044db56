"""The page as a document, which holds what it shows or asks its server for it.

`web/` has its sources; `npm ci && npm run build` there writes `bundle/`, which is shipped.
"""

from __future__ import annotations

import base64
import gzip
import html
from pathlib import Path

from bridge.export.output import about_in_a_line
from bridge.runtime.moving_body import MovingBody
from bridge.view.repertoire import Repertoire, path_title, take_of
from bridge.view.scene import BUNDLE, Scene

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
