"""The viewer and its recording in a real browser: they load, play, and do what controls say."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.view.performances import Performances
from bridge.view.repertoire import SMPL_ALONE, open_repertoire
from tools.headless_chromium import PATIENCE_MS, OpenPage, chromium, open_page, why_missing

if TYPE_CHECKING:
    from playwright.sync_api import Browser

from tests.bridge.view.conftest import FRAMES

pytest.importorskip("viser", reason="viser is not installed")
from bridge.view.stage_view import write_recording
from bridge.view.viewer import Viewer, serving

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]


def until(true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_MS / 1000
    while not true():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.2)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def viewer(run, browser) -> Iterator[tuple[Viewer, OpenPage]]:
    performances = Performances(open_repertoire(run, None))
    with serving("127.0.0.1", 0) as server:
        found = Viewer(server, performances)
        drawing = threading.Thread(target=found.run)
        drawing.start()
        try:
            with open_page(browser, f"http://127.0.0.1:{server.get_port()}") as opened:
                opened.page.get_by_role("button", name="Pause").wait_for()
                yield found, opened
                assert opened.errors == []
        finally:
            found.stop()
            drawing.join()
            performances.worker.stop()


def picture(opened: OpenPage) -> bytes:
    return opened.page.screenshot(timeout=PATIENCE_MS)


def vertices_m(viewer: Viewer, name: str = SMPL_ALONE) -> np.ndarray:
    return viewer.scene.figures[name].vertices_m.copy()


def set_number(opened: OpenPage, label: str, text: str) -> None:
    opened.number(label).fill(text)


def test_it_loads_says_synthetic_and_has_drawn_something(viewer):
    _, opened = viewer
    assert opened.page.get_by_text("synthetic").count() >= 1
    assert opened.page.locator("canvas").first.is_visible()
    opened.page.get_by_text("Error over time").first.wait_for()


def test_it_plays_pauses_and_is_scrubbed(viewer):
    found, opened = viewer
    frame = opened.number("Frame")
    first = frame.input_value()
    until(lambda: frame.input_value() != first)
    opened.press("Pause")
    until(lambda: not found.timeline.playing)
    # A page that lags shows frames from before, over what is typed.
    until(lambda: frame.input_value() == f"{found.timeline.frame}")
    set_number(opened, "Frame", "17")
    until(lambda: found.timeline.frame == 17)
    opened.page.get_by_role("button", name="Play").wait_for()


def test_a_hand_on_the_slider_pauses_where_it_is(viewer):
    found, opened = viewer
    frame = opened.number("Frame")
    opened.press("Play")
    until(lambda: found.timeline.playing)
    # A key that moves to the frame which page or clock just has changes nothing and is not told.
    keys = itertools.cycle(("Home", "End"))

    def paused_by_a_key() -> bool:
        opened.slider("Frame").dispatch_event("keydown", {"key": next(keys)})
        opened.page.wait_for_timeout(1000)
        return not found.timeline.playing

    until(paused_by_a_key)
    until(lambda: frame.input_value() == f"{found.timeline.frame}")


def test_a_slider_changes_the_mesh_and_the_picture(viewer):
    found, opened = viewer
    before, seen = vertices_m(found), picture(opened)
    opened.open_folder("Betas")
    set_number(opened, "Beta 1", "4")
    until(lambda: found.panel.selection.betas[0] == 4.0)
    until(lambda: bool(np.abs(vertices_m(found) - before).max() > 0.02))
    until(lambda: picture(opened) != seen)
    opened.press("Shape of the person")
    until(lambda: found.panel.selection.betas[0] == 0.5)


def test_gain_changes_the_predicted_body(viewer):
    found, opened = viewer
    set_number(opened, "Gain", "3")
    until(lambda: found.panel.selection.gains.of_all == 3.0)
    set_number(opened, "Gain", "1")
    until(lambda: found.panel.selection.gains.of_all == 1.0)


def test_a_part_gain_changes_the_mesh(viewer):
    found, opened = viewer
    found.timeline.stop_at(20)  # in the air
    until(lambda: found.panel._told == 20)
    assert found.performances.worker.wait(PATIENCE_MS / 1000)
    before = vertices_m(found, "dsnet_plus")
    opened.open_folder("Gain by part")
    set_number(opened, "belly", "5")
    until(lambda: bool(np.abs(vertices_m(found, "dsnet_plus") - before).max() > 1e-3))
    set_number(opened, "belly", "1")
    until(lambda: bool(np.abs(vertices_m(found, "dsnet_plus") - before).max() == 0))


def test_the_pickers_change_motion_and_person(viewer):
    found, opened = viewer
    before = np.ptp(vertices_m(found)[:, 1])
    opened.choose("Person", "tall")
    until(lambda: bool(np.ptp(vertices_m(found)[:, 1]) > before + 0.05))
    opened.choose("Person", "who moved")
    until(lambda: bool(abs(np.ptp(vertices_m(found)[:, 1]) - before) < 0.01))
    opened.choose("Motion", "50004_stand (trained on)")
    until(lambda: found.timeline.frames == FRAMES)
    until(lambda: not found.scene.figures["truth"].root.visible)
    opened.page.get_by_text("Error over time").first.wait_for(state="hidden")


def test_the_recording_button_gives_a_file_that_plays(viewer, browser, tmp_path: Path):
    _, opened = viewer
    with opened.page.expect_download() as download:
        opened.press("Recording (HTML)")
        # The page offers the file when it is there.
        opened.page.get_by_text("dsnet.html").last.dispatch_event("click")
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    check_that_it_plays(browser, path)


def test_a_recording_plays_from_a_file_without_any_server(tmp_path: Path, browser):
    path = tmp_path / "recording.html"
    write_recording(path, Performances(open_repertoire(None, None), most_s=0.5))
    check_that_it_plays(browser, path)


def check_that_it_plays(browser: Browser, path: Path) -> None:
    with open_page(browser, path.as_uri()) as opened:
        played = opened.page.locator("input").first
        played.wait_for()
        until(lambda: float(played.input_value()) > 0.0)
        opened.page.keyboard.press("Space")
        assert len(picture(opened)) > 10_000
        assert opened.errors == []
