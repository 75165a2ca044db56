"""A page in a browser, and what is drawn in it."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.runs import Run
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.view.application import opened
from dsnet.view.clip_list import open_clip_list
from dsnet.view.page import document
from dsnet.view.scene import Scene
from dsnet.view.server import serving
from tools.headless_chromium import PATIENCE_MS, OpenPage, open_page
from tools.headless_firefox import FirefoxPage

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_VERTICES = """async ([name, frame]) => {
  page.play(false);
  page.seek(frame);
  const turn = () => new Promise(requestAnimationFrame);
  do { await turn(); await turn(); } while (page.time !== frame || !page.frames.get(frame)?.exact);
  await turn(); await turn();
  const { array } = page.stage.bodies[name].geometry.attributes.position;
  let text = "";
  const bytes = new Uint8Array(array.buffer);
  for (let i = 0; i < bytes.length; i += 32768)
    text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text);
}"""

TORN = """async (wanted) => {
  const canvas = document.getElementById("view"), turn = () => new Promise(requestAnimationFrame);
  const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  const flat = copy.getContext("2d", { willReadFrequently: true }), seen = [];
  const pixels = () => { flat.drawImage(canvas, 0, 0); return flat.getImageData(0, 0, copy.width, copy.height).data; };
  let last = page.time; // what is there at first was drawn before, perhaps in other colours
  page.play(true);
  while (seen.length < wanted) { await turn(); if (page.time !== last) seen.push({ time: last = page.time, was: pixels() }); }
  let apart = 0;
  for (const { time, was } of seen) {
    page.seek(time);
    for (let i = 0; i < 4000 && !(page.time === time && page.frames.get(Math.floor(time)) && page.frames.get(Math.ceil(time))); i++) await turn();
    await turn(); await turn();
    pixels().forEach((value, i) => { apart += value !== was[i]; });
  }
  return apart;
}"""  # fmt: skip  # noqa: E501
"""How many numbers of pixels differ between playing and resting, of so many moments."""

BETAS = [1.0, -1.0, 0.5, 0.3, 0.0, 0.0, 0.0, 0.0, 0.2, -2.0]
CLOSE_M = 1e-5


class Shown:
    """A page that is ready."""

    def __init__(self, opened: OpenPage | FirefoxPage) -> None:
        self.page: Any = opened.page if isinstance(opened, OpenPage) else opened
        self.errors = opened.errors
        self.page.wait_for_selector("body[data-ready]", state="attached")

    def vertices_m(self, name: str, frame: int) -> np.ndarray:
        """(V, 3) of a body, when its exact frame is drawn; copies on seams, which follow, agree."""
        text = self.page.evaluate(_VERTICES, [name, frame])
        drawn_m = np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, 3)
        count, *copy_of = self.page.evaluate(
            "[page.stage.body.count, ...page.stage.skin?.copyOf ?? []]"
        )
        np.testing.assert_array_equal(drawn_m[count:], drawn_m[copy_of])
        return drawn_m[:count]

    def moves_as_predicted(
        self,
        motion: str | Path,
        *frames: int,
        body: str | None = None,
        close_m: float = CLOSE_M,
        **controls: Any,
    ) -> None:
        """Frames of the one body, in this order, are those of `dsnet predict`; -1 is the last."""
        expected_m = predicted_m(motion, body, **controls)
        for frame in frames:
            found_m = self.vertices_m("dsnet_plus", frame % len(expected_m))
            np.testing.assert_allclose(found_m, expected_m[frame], atol=close_m)

    def says(self) -> str:
        """Its one line."""
        return self.page.inner_text("#says")

    def set(self, **values: Any) -> None:
        """Move knobs, by their ids."""
        self.page.evaluate(
            """(values) => { for (const [id, value] of Object.entries(values)) {
                const knob = document.getElementById(id);
                if (typeof value === "boolean") knob.checked = value; else knob.value = value;
                knob.oninput?.(); knob.onchange?.();
            } }""",
            values,
        )

    def surveyed(self) -> None:
        """Wait until all curves are there."""
        self.until("page.curves.filter(Boolean).length === page.motion.count")

    def until(self, true: str) -> None:
        """Wait for an expression; a page that allows no `eval` is asked again and again."""
        end_s = time.monotonic() + PATIENCE_MS / 1000
        while not self.page.evaluate(true):
            assert time.monotonic() < end_s, f"waited in vain for {true}"
            time.sleep(0.1)


@contextmanager
def serve(scene: Scene, port: int = 0, run: Run | None = None) -> Iterator[str]:
    """The address of its page, as `dsnet view` serves it."""
    with opened(scene, run, Controls()) as application, serving(application, port) as address:
        yield address


@contextmanager
def served(
    browser: Browser, scene: Scene, width_px: int = 400, height_px: int = 300
) -> Iterator[Shown]:
    """Its page from a server."""
    with serve(scene) as address, open_page(browser, address, width_px, height_px) as opened:
        yield Shown(opened)


@contextmanager
def on_disk(browser: Browser, page: Path, scene: Scene | None = None) -> Iterator[Shown]:
    """Its page as a file; without a scene the file is there."""
    if scene is not None:
        page.write_text(document(scene), encoding="utf-8")
    with open_page(browser, page.as_uri()) as opened:
        yield Shown(opened)


def numbers(text: str, dtype: str) -> np.ndarray:
    """An array of a scene's JSON."""
    return np.frombuffer(base64.b64decode(text), dtype)


def facts_of(scene: Scene) -> dict[str, Any]:
    """A scene's facts."""
    return json.loads(scene.assets["scene"]())


def track_m(track: bytes, vertices: int = 6890) -> np.ndarray:
    """(T, V, 3) of a track, metres."""
    step_m = np.frombuffer(track, "<f4", 1)[0]
    steps = np.frombuffer(track, "<i2", offset=4).reshape(-1, 3, vertices)
    return (step_m * np.cumsum(steps, axis=0, dtype=np.int16)).transpose(0, 2, 1)


def packaged(motion: str | Path = "sample:dancing") -> Scene:
    return Scene(open_clip_list(None, Path(motion)))


def predicted_m(motion: str | Path, body: str | None = None, **controls: Any) -> np.ndarray:
    asked = Controls(body=Path(body) if body else None, **controls)
    moving = controlled_body(*asked.load(None, None, Path(motion)), asked)
    return np.concatenate([piece.vertices_m for piece in moving])


def read_by_page(shown: Shown, path: Path) -> dict[str, Any]:
    """What a page from a disk makes of a file; `refused` is its line if that is none."""
    read = """([text, name]) => page.readBytes(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)), name)
                .then((found) => ({ ...found, theta: [...found.theta] }),
                      ({ message }) => ({ refused: message }))"""  # noqa: E501
    return shown.page.evaluate(read, [base64.b64encode(path.read_bytes()).decode(), path.name])


def dropped(shown: Shown, path: Path) -> str:
    """What the page says of a file."""
    shown.page.evaluate("document.getElementById('says').textContent = ''")
    shown.page.set_input_files("#file", str(path))
    shown.until("document.getElementById('says').textContent !== ''")
    return shown.says()
