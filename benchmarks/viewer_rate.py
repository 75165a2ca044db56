"""`python -m benchmarks.viewer_rate --out DIR --run RUN`: frames a second that the viewer shows.

Twice: what a frame costs the server, and how many pictures with new vertices a Chromium without a
window draws. Without a graphics card the second is mostly the cost of drawing on processors.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bridge.processes import run_as_process
from bridge.runs.files import write_text_atomically
from bridge.view.viewer import Viewer
from tools.headless_chromium import chromium, open_page
from tools.served_viewer import served_viewer

_SERVER_FRAMES = 200
_WARM_S = 5.0
_LEAST_BYTES = 2000
"""Of an upload that is counted: those of labels and the interface are smaller."""
# Counts pictures of the page, and those before which vertices were sent to the graphics card.
_COUNT = f"""
window.counted = {{pictures: 0, moved: 0}};
let uploaded = false;
const card = WebGL2RenderingContext.prototype;
for (const name of ["bufferData", "bufferSubData"]) {{
  const original = card[name];
  card[name] = function (...values) {{
    uploaded ||= values.some((one) => one?.byteLength > {_LEAST_BYTES});
    return original.apply(this, values);
  }};
}}
function tick() {{
  window.counted.pictures += 1;
  window.counted.moved += uploaded ? 1 : 0;
  uploaded = false;
  requestAnimationFrame(tick);
}}
requestAnimationFrame(tick);
"""
_PAGE = """\
| bodies | server, ms a frame | slowest twentieth, ms | pictures a second | with new vertices |
|---:|---:|---:|---:|---:|
| {bodies} | {server_ms:.1f} | {server_slow_ms:.1f} | {pictures_hz:.0f} | {moved_hz:.0f} |

The viewer pushes at most {pushed_hz:.0f} frames a second. {chromium}, {width_px} x {height_px}
pixels, {renderer}; {cores} cores. Made by `{command}`.
"""


@dataclass(frozen=True)
class RateConfig:
    """Play the first motion as the viewer shows it at the start."""

    out: Path
    """Folder that receives viewer_rate.json and viewer_rate.md."""
    run: str | None = None
    """Run whose first motion is played; the packaged model when left out, which has no truth."""
    seconds: float = 15.0
    """How long the browser is watched."""
    width_px: int = 900
    """Of the page."""
    height_px: int = 600
    """Of the page."""


def main(config: RateConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If the browser, or what is to be seen, is missing.
    """
    with served_viewer(config.run) as served:
        viewer = served.viewer
        results = _server_ms(viewer)
        with served.drawing():
            results |= _watched(served.address, config)
    results |= {
        "bodies": len(viewer.scene.figures),
        "pushed_hz": viewer.DRAWN_HZ,
        "width_px": config.width_px,
        "height_px": config.height_px,
        "cores": os.cpu_count(),
        "command": " ".join(["python", "-m", "benchmarks.viewer_rate", *sys.argv[1:]]),
    }
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / "viewer_rate.json", text)
    write_text_atomically(config.out / "viewer_rate.md", _PAGE.format(**results))
    return results


def _server_ms(viewer: Viewer) -> dict[str, float]:
    """Of drawing a frame, before anybody looks."""
    taken_ms = []
    for _ in range(_SERVER_FRAMES):
        start_s = time.perf_counter()
        viewer.draw(1 / viewer.DRAWN_HZ)
        taken_ms.append(1e3 * (time.perf_counter() - start_s))
    slow_ms = float(np.percentile(taken_ms, 95))
    return {"server_ms": float(np.median(taken_ms)), "server_slow_ms": slow_ms}


def _watched(address: str, config: RateConfig) -> dict[str, Any]:
    size = config.width_px, config.height_px
    with chromium() as browser, open_page(browser, address, *size, before=_COUNT) as opened:
        opened.page.get_by_role("button", name="Pause").wait_for()
        time.sleep(_WARM_S)
        before, start_s = opened.page.evaluate("({...window.counted})"), time.perf_counter()
        time.sleep(config.seconds)
        after, end_s = opened.page.evaluate("({...window.counted})"), time.perf_counter()
        counts = {f"{name}_hz": (after[name] - before[name]) / (end_s - start_s) for name in after}
        return counts | {"chromium": f"Chromium {browser.version}", "renderer": _renderer(opened)}


def _renderer(opened: Any) -> str:
    return opened.page.evaluate(
        """() => {
          const card = document.createElement("canvas").getContext("webgl2");
          const known = card.getExtension("WEBGL_debug_renderer_info");
          return card.getParameter(known ? known.UNMASKED_RENDERER_WEBGL : card.RENDERER);
        }"""
    )


if __name__ == "__main__":
    run_as_process(RateConfig, main)
