"""Pictures of moving bodies: the tool makes them, pages name them, and they are not too large."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bridge import DsnetError
from bridge.motion.sample_files import sample_path
from bridge.runtime.characters import open_for_motion
from bridge.runtime.controls import Controls, controlled_body
from tests.forged.cyclic import circling
from tools import build_gallery
from tools.build_gallery import MAKERS, PICTURES, Gallery, main
from tools.gallery.laps import best_lap, closed_lap
from tools.gallery.performed import performed
from tools.gallery.stills import Look, Moment, draw_lying, draw_upright

ROOT = Path(__file__).parents[1]
SMALL = Look(width_px=90, samples=1, body_px=100)
MOST_BYTES = {".gif": 3_000_000, ".png": 1_000_000}


def test_every_picture_is_there_and_on_the_page_with_its_command():
    page = (ROOT / "docs" / "gallery.md").read_text()
    assert {path.name for path in PICTURES.iterdir()} == set(MAKERS)
    assert set(re.findall(r"images/gallery/([\w.]+)", page)) == set(MAKERS)
    commands = set(
        re.findall(r"`python -m tools.build_gallery (?:--run demo )?--only (\S+)`", page)
    )
    assert commands == set(MAKERS)
    assert "synthetic" in page.lower()


@pytest.mark.parametrize("name", MAKERS)
def test_a_picture_is_not_too_large_and_a_clip_says_synthetic(name):
    path = PICTURES / name
    assert path.stat().st_size <= MOST_BYTES[path.suffix]
    with Image.open(path) as picture:
        assert picture.size[0] <= 1200
        if path.suffix == ".gif":
            assert picture.info["comment"].startswith(b"synthetic")
            assert picture.info["loop"] == 0


def test_the_opening_clip_is_on_readme_as_wide_as_it_is():
    with Image.open(PICTURES / "jumping_jacks.gif") as clip:
        width = clip.size[0]
    shown = f'<img src="docs/images/gallery/jumping_jacks.gif" width="{width}"'
    assert shown in (ROOT / "README.md").read_text()


@pytest.fixture(scope="module")
def sample(tmp_path_factory) -> Path:
    """Five frames of the sample motion, as a file of AMASS."""
    with np.load(sample_path("jumping_jacks")) as whole:
        arrays = dict(whole)
    arrays |= {key: arrays[key][100:105] for key in ("poses", "trans")}
    path = tmp_path_factory.mktemp("given") / "a_poses.npz"
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("name", ["shapes.png", "gains.png"])
def test_pictures_of_the_packaged_model(sample, tmp_path, monkeypatch, name):
    monkeypatch.setattr(build_gallery, "SAMPLE", sample)
    main(Gallery(only=(name,), out=tmp_path, look=SMALL))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with Image.open(tmp_path / name) as picture:
        page = np.asarray(picture.convert("RGB")).astype(int)
    assert (np.ptp(page, axis=-1) > 80).mean() > 0.01  # colours
    assert (page.min(axis=-1) > 250).mean() > 0.4  # on white


@pytest.mark.parametrize("draw", [draw_upright, draw_lying])
def test_each_body_has_its_colours(sample, tmp_path, draw):
    character, motion = open_for_motion(None, None, sample)
    moving = [controlled_body(character, motion, Controls(gain=gain)) for gain in (0.0, 3.0)]
    bodies = [performed("still", moving[0]), performed("moved", moving[1])]
    path = tmp_path / "a.png"
    draw(path, Moment(bodies, 2, moving[0], "title"), SMALL)
    with Image.open(path) as picture:
        page = np.asarray(picture.convert("RGB")).astype(int)
    without_bar = page[60:-60, : int(0.85 * page.shape[1])]
    halves = np.array_split(without_bar, 2, axis=0 if draw is draw_lying else 1)
    painted = [half.min(axis=-1)[np.ptp(half, axis=-1) > 40] for half in halves]
    still, moved = (np.quantile(values, 0.1) for values in painted)
    assert still > moved + 20


def test_a_lap_is_one_round_of_what_repeats():
    theta = circling(130, lap=48, turn_rad=0.001, stride_m=1e-3)
    lap = best_lap(theta, 3)
    assert (lap.stop - lap.start, (lap.stop - lap.start) % 3) == (48, 0)


def test_a_lap_of_the_sample_closes():
    character, motion = open_for_motion(None, None, Path("sample:jumping_jacks"))
    lap = closed_lap(motion.theta, 3)
    moving = controlled_body(character, replace(motion, theta=lap), Controls(loop=True))
    assert len(moving) == len(lap) > 40
    # The step over the seam is as long as its neighbours'.
    steps = np.abs(np.diff(np.concatenate([lap[-2:], lap[:2]]), axis=0)).max(axis=1)
    assert steps[1] < 1.5 * max(steps[0], steps[2])


def test_an_unknown_picture_is_refused(tmp_path):
    with pytest.raises(DsnetError, match=r"--only x\.png; expected names among jumping_jacks\.gif"):
        main(Gallery(only=("x.png",), out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
