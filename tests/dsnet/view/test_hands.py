"""The page under a person's hands: keys, camera, views, colours, and what is saved."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from bridge.motion.readers.amass import sample_path
from tests.dsnet.view.pages import Shown, packaged, serve
from tools.headless_chromium import open_page, why_missing

if TYPE_CHECKING:
    pass

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]
FRAME = 12
_PIXELS = """async () => {
  for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame);
  return document.getElementById("view").toDataURL();
}"""


@pytest.fixture(scope="module")
def motion(tmp_path_factory) -> Path:
    """A third of a second."""
    with np.load(sample_path("dancing")) as sample:
        short = {
            key: sample[key][:20] if key in ("poses", "trans") else sample[key] for key in sample
        }
    path = tmp_path_factory.mktemp("motion") / "short dance.npz"
    np.savez(path, **short)
    return path


@pytest.fixture(scope="module")
def page(browser, motion) -> Iterator[Shown]:
    with serve(packaged(motion)) as address, open_page(browser, address, 686, 400) as opened:
        yield Shown(opened)
        assert opened.errors == []
        assert opened.warnings == []


@pytest.fixture
def shown(page) -> Shown:
    """At rest, as it is at first."""
    page.page.evaluate("document.activeElement.blur()")
    page.page.evaluate("page.stage.reset()")
    page.set(colouring="size", layout="side", gain=1)
    page.page.wait_for_timeout(300)  # a gain that has rested a quarter of a second is surveyed anew
    page.surveyed()
    page.vertices_m("dsnet_plus", FRAME)
    return page


def pixels(shown: Shown) -> np.ndarray:
    """(H, W, 3) of the canvas."""
    return _decoded(base64.b64decode(shown.page.evaluate(_PIXELS).partition(",")[2]))


def _decoded(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"), float)


def halves(shown: Shown) -> tuple[np.ndarray, np.ndarray]:
    seen = pixels(shown)
    middle = seen.shape[1] // 2
    return seen[:, :middle], seen[:, middle:]


def value(shown: Shown, expression: str) -> Any:
    shown.page.evaluate("() => new Promise(requestAnimationFrame)")
    return shown.page.evaluate(expression)


def test_colours_are_on_at_first_and_the_legend_tells_of_gravity(browser, motion):
    with serve(packaged(motion)) as address, open_page(browser, address, 686, 400) as opened:
        shown = Shown(opened)
        assert value(shown, "document.getElementById('colouring').value") == "size"
        assert "gravity" in shown.page.inner_text("#about")
        shown.set(colouring="none")
        shown.until("document.getElementById('legend').hidden")
        assert shown.page.inner_text("#about") == ""


@pytest.mark.parametrize("key", ["1", "2", "3", "r"])
def test_views_show_one_body_each_by_the_same_camera(shown, key):
    shown.page.keyboard.press(key)
    alone, moved = halves(shown)
    assert np.abs(alone - moved).max() > 60  # colours
    shown.set(colouring="none", gain=0)  # now both are SMPL alone
    shown.vertices_m("dsnet_plus", FRAME)
    unchanged, twin = halves(shown)
    np.testing.assert_array_equal(unchanged, alone)
    assert np.abs(unchanged - twin).mean() < 0.1
    background = unchanged[5, 5]
    assert 0.01 < (np.abs(unchanged - background).max(axis=-1) > 60).mean() < 0.5  # one body


@pytest.mark.parametrize(
    ("layout", "in_the_middle"), [("side", False), ("overlay", True), ("wipe", True)]
)
def test_bodies_are_in_one_view_or_in_their_own(shown, layout, in_the_middle):
    shown.set(layout=layout)
    seen = pixels(shown)
    middle = seen[:, seen.shape[1] // 2 + 10]  # a column, beside the wipe
    assert (np.abs(middle - seen[5, 5]).max() > 60) == in_the_middle


def test_labels_stay_in_their_views(shown):
    boxes = [shown.page.locator(f"#tag-{name}").bounding_box() for name in ("smpl", "dsnet_plus")]
    left, right = boxes
    middle = value(shown, "document.getElementById('view').clientWidth / 2")
    assert 0 <= left["x"] < left["x"] + left["width"] <= middle <= right["x"]
    assert right["x"] + right["width"] <= 2 * middle


@pytest.mark.parametrize(
    ("key", "expression", "expected"),
    [
        ("ArrowRight", "page.time", FRAME + 1),
        ("ArrowLeft", "page.time", FRAME - 1),
        ("Home", "page.time", 0),
        ("End", "page.time", 19),
        ("t", "page.stage.turns", True),
        ("C", "document.getElementById('colouring').value", "none"),
        (" ", "document.getElementById('play').textContent", "Pause"),
        ("?", "document.getElementById('keys').matches(':popover-open')", True),
        ("f", "document.fullscreenElement?.tagName", "MAIN"),
    ],
)
def test_keys_work_without_a_focus(shown, key, expression, expected):
    assert value(shown, expression) != expected
    shown.page.keyboard.press(key)
    shown.until(f"({expression}) === {json.dumps(expected)}")
    if key in "tf?":
        shown.page.keyboard.press(key)
        shown.until(f"({expression}) !== {json.dumps(expected)}")


def test_the_loop_has_a_key(shown):
    shown.page.keyboard.press("l")
    shown.until("document.getElementById('loop').checked")
    shown.page.keyboard.press("l")
    shown.until("!document.getElementById('loop').checked")


def test_keys_of_an_element_are_its_own(shown):
    shown.page.focus("#motion")
    shown.page.keyboard.press("c")
    assert value(shown, "document.getElementById('colouring').value") == "size"
    shown.page.focus("#gain")
    shown.page.keyboard.press("ArrowRight")
    assert value(shown, "page.time") == FRAME
    shown.page.keyboard.press("c")
    assert value(shown, "document.getElementById('colouring').value") == "none"


def test_the_turntable_turns_the_camera(shown):
    shown.page.keyboard.press("1")
    before = value(shown, "page.stage.camera.position.x")
    shown.page.keyboard.press("t")
    shown.until(f"Math.abs(page.stage.camera.position.x - {before}) > 0.05")
    shown.page.keyboard.press("r")
    assert value(shown, "page.stage.turns") is False


def test_a_picture_is_saved_with_its_notice(shown):
    with shown.page.expect_download() as saved:
        shown.page.keyboard.press("s")
    assert saved.value.suggested_filename == "short_dance.png"
    picture, canvas = _decoded(Path(saved.value.path()).read_bytes()), pixels(shown)
    assert picture.shape == canvas.shape
    for selector in ("#notice", "#tag-smpl", "#scale"):
        box = shown.page.locator(selector).bounding_box()
        rows = slice(int(box["y"]), int(box["y"] + box["height"]))
        columns = slice(int(box["x"]), int(box["x"] + min(box["width"], 150)))
        assert np.abs(picture - canvas)[rows, columns].max() > 60, selector


def test_one_pass_is_saved_as_a_video(shown):
    with shown.page.expect_download() as saved:
        shown.page.click("#clip")
    assert saved.value.suggested_filename == "short_dance.webm"
    assert Path(saved.value.path()).read_bytes().startswith(b"\x1aE\xdf\xa3")
    assert shown.page.inner_text("#clip") == "Video"


def test_the_page_is_dark_where_the_system_is(shown):
    light = pixels(shown)[5, 5]
    paper = "getComputedStyle(document.body).backgroundColor"
    lit = value(shown, paper)
    shown.page.emulate_media(color_scheme="dark")
    dark = pixels(shown)[5, 5]
    assert light.min() > 200
    assert dark.max() < 80
    assert value(shown, paper) != lit
    shown.page.emulate_media(color_scheme="light")
    np.testing.assert_array_equal(pixels(shown)[5, 5], light)


def test_gains_end_where_flesh_is_flesh(shown):
    assert value(shown, "document.getElementById('gain').max") == "3"
    assert value(shown, "document.getElementById('part0').max") == "3"


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 760), (1920, 1080)])
def test_nothing_runs_over(shown, width, height):
    before = shown.page.viewport_size
    shown.page.set_viewport_size({"width": width, "height": height})
    for element in ("document.documentElement", "document.querySelector('aside')"):
        assert value(shown, f"{element}.scrollWidth <= {element}.clientWidth")
    tools = shown.page.locator("#tools").bounding_box()
    assert 0 <= tools["x"] <= tools["x"] + tools["width"] <= width
    shown.page.set_viewport_size(before)
