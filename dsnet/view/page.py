"""The viewer's page: one HTML file that holds its assets, or loads them from a server.

Its sources are in `web/`; `npm ci && npm run build` there writes `bundle/`, which is shipped.
"""

from __future__ import annotations

import base64
import gzip
import html
from pathlib import Path

from dsnet.exporters.output import facts_in_a_line
from dsnet.prediction.moving_body import MovingBody
from dsnet.view.clip_list import ClipList, clip_of, path_title
from dsnet.view.scene import BUNDLE, Scene

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
    scene = Scene(clip_list, moving.controls, moving.loop, moving.plain)
    text = document(scene, facts_in_a_line(moving, *others))
    path.write_text(text, encoding="utf-8", newline="\n")
