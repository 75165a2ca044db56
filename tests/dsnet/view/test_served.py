"""The served page: any file is dropped and read by Python, and what is shown is exported."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.motion.readers.amass import sample_path
from dsnet.cli import main
from tests.dsnet.view.pages import Shown, dropped, packaged, served
from tools.headless_chromium import why_missing

if TYPE_CHECKING:
    pass

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(why_missing() is not None, reason=why_missing() or ""),
]


@pytest.fixture
def page(browser) -> Iterator[Shown]:
    with served(browser, packaged("sample:walk_cycle"), 900, 600) as shown:
        yield shown
        assert shown.errors == []


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    """A third of a second, as a BVH of this project."""
    folder = tmp_path_factory.mktemp("walk")
    with np.load(sample_path("walking")) as sample:
        count = len(sample["poses"])
        cut = {name: v[:40] if v.shape[:1] == (count,) else v for name, v in sample.items()}
    np.savez(folder / "walk.npz", **cut)
    out = folder / "walk.bvh"
    main(["export", "--to", "bvh", "--motion", str(folder / "walk.npz"), "--out", str(out)])
    return out


def opened(shown: Shown, path: Path) -> None:
    """Drop a file that can be read."""
    shown.page.set_input_files("#file", str(path))
    shown.until(f"page.motion?.name === {path.stem!r}")


def read_otherwise(shown: Shown, option: str, value: str) -> None:
    """Set one of the fields that say how a file is read."""
    shown.page.evaluate(
        """([option, value]) => { const field = document.querySelector(`[data-reading=${option}]`);
                                  field.value = value; field.onchange(); }""",
        [option, value],
    )


def test_a_bvh_moves_as_predicted_and_is_read_again_by_other_options(page, walk):
    opened(page, walk)
    page.moves_as_predicted(walk, 0, -1)
    frames = page.page.evaluate("page.motion.count")
    read_otherwise(page, "motion_fps", "30")
    page.until(f"page.motion.count > 1.5 * {frames}")
    page.moves_as_predicted(walk, -1, motion_fps=30.0)
    read_otherwise(page, "motion_fps", "0")
    page.until("document.getElementById('says').textContent !== ''")
    assert "--motion-fps" in page.says()
    assert page.page.input_value("[data-reading=motion_fps]") == "30.0"


def test_a_body_of_the_other_gender_is_another_scene(page, walk):
    opened(page, walk)
    page.page.evaluate("document.body.dataset.old = 1")
    read_otherwise(page, "gender", "male")
    page.page.wait_for_selector("body[data-ready]:not([data-old])", state="attached")
    page.moves_as_predicted(walk, 10, gender="male")
    assert page.page.input_value("[data-reading=gender]") == "male"
    # What the page still loaded when it was left.
    page.errors[:] = [one for one in page.errors if not one.startswith("no ")]


def test_what_is_shown_is_exported_into_the_downloads(page, walk, tmp_path):
    opened(page, walk)
    page.page.fill("#words", "tall heavy")
    page.page.dispatch_event("#words", "change")
    page.until("page.betas.some((beta) => Math.abs(beta) > 1)")
    betas = ",".join(map(str, page.page.evaluate("page.betas")))
    page.set(gain=2)
    page.page.select_option("#format", "glb")
    with page.page.expect_download() as download:
        page.page.click("#export")
    assert download.value.suggested_filename == "walk.glb"
    out = tmp_path / "walk.glb"
    command = [sys.executable, "-m", "dsnet.cli", "export", "--to", "glb", "--motion", str(walk)]
    options = ["--gain", "2", f"--betas={betas}", "--floor", "shift", "--out", str(out)]
    subprocess.run([*command, *options], check=True, capture_output=True)
    assert Path(download.value.path()).read_bytes() == out.read_bytes()
    assert "--gain=2.0" in page.page.inner_text("#command")


def test_an_export_that_fails_says_why_and_can_be_cancelled(page):
    page.page.select_option("#format", "gif")
    page.page.click("#export")
    page.page.click("#cancel")
    page.until("!document.getElementById('export').disabled")
    assert page.says() == ""


@pytest.mark.parametrize(
    ("name", "size", "words"),
    [
        ("damaged.bvh", 100, "damaged.bvh"),
        ("large.fbx", 10 << 20, "large.fbx"),
        ("too_large.glb", 200 << 20, "at most 128 MB"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_line_and_what_played_plays_on(
    page, tmp_path, name, size, words
):
    with (tmp_path / name).open("wb") as file:
        file.write(b"HIERARCHY\n")
        file.truncate(size)
    before = page.page.evaluate("page.motion.name")
    said = dropped(page, tmp_path / name)
    assert words in said
    assert "\n" not in said
    assert page.page.evaluate("page.motion.name") == before
