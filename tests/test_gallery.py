"""Pictures of moving bodies: the tool makes them, pages name them, and they are not too large."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bridge import DsnetError
from bridge.motion.readers.amass import sample_path
from dsnet.prediction.controls import Controls, controlled_body
from tests.forged.cyclic import circling
from tools import build_gallery
from tools.build_gallery import (
    FREE_FILE,
    MAKERS,
    PICTURES,
    RECORDED,
    UNPUBLISHED,
    Gallery,
    main,
)
from tools.gallery.laps import best_lap, closed_lap
from tools.gallery.performed import performed
from tools.gallery.stills import Look, Moment, draw_lying, draw_upright

ROOT = Path(__file__).parents[1]
SMALL = Look(width_px=90, body_px=100)
MOST_BYTES = {".gif": 3_000_000, ".png": 1_000_000}


def test_every_picture_is_there_and_on_the_page_with_its_command():
    page = (ROOT / "docs" / "gallery.md").read_text()
    assert {path.name for path in PICTURES.iterdir()} == set(MAKERS)
    assert set(re.findall(r"images/gallery/([\w.]+)", page)) == set(MAKERS)
    options = r"(?:--run demo )?(?:--recording \S+ )?--only (\S+)"
    commands = set(re.findall(rf"`python -m tools.build_gallery {options}`", page))
    assert commands == set(MAKERS)
    assert "synthetic" in page.lower()


def test_the_recorded_clip_is_named_on_the_page_as_its_makers_ask():
    page = (ROOT / "docs" / "gallery.md").read_text()
    section = " ".join(page.partition("## Recorded jumps")[2].partition("\n## ")[0].split())
    for said in (
        "The data used in this project was obtained from [mocap.cs.cmu.edu]",
        "The database was created with funding from NSF EIA-0196217.",
        "Bodies and tissue synthetic, motion recorded",
        f"--recording {FREE_FILE} --only {RECORDED}`",
        "subject 01",
        "motion 01",
    ):
        assert said in section
    assert "motions are synthetic too, but for [one" in " ".join(page.split())


def test_no_other_recording_is_in_the_pages():
    """Clips say of which file they are; those of the synthetic corpus are its takes'."""
    names = {}
    for path in PICTURES.glob("*.gif"):
        with Image.open(path) as clip:
            (motion,) = re.findall(rb"motion (\S+), controls", clip.info["comment"])
            names[path.name] = motion.decode()
    assert names.pop(RECORDED) == FREE_FILE
    assert [name for name in names.values() if not re.match(r"50\d{3}_\w+_poses\.npz$", name)] == []


def test_the_recorded_clip_is_smoothed_and_shows_some_seconds_as_wide_as_it_is():
    page = (ROOT / "docs" / "gallery.md").read_text()
    with Image.open(PICTURES / RECORDED) as clip:
        assert b'"smooth_hz": "auto"' in clip.info["comment"]
        assert 3.0 <= getattr(clip, "n_frames", 1) * clip.info["duration"] / 1000 <= 5.0
        assert f'<img src="images/gallery/{RECORDED}" width="{clip.size[0]}"' in page


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
    character, motion = Controls().load(None, None, sample)
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
    character, motion = Controls().load(None, None, Path("sample:jumping_jacks"))
    lap = closed_lap(motion.theta, 3)
    moving = controlled_body(character, replace(motion, theta=lap), Controls(loop=True))
    assert len(moving) == len(lap) > 40
    # The step over the seam is as long as its neighbours'.
    steps = np.abs(np.diff(np.concatenate([lap[-2:], lap[:2]]), axis=0)).max(axis=1)
    assert steps[1] < 1.5 * max(steps[0], steps[2])


@pytest.fixture
def stubs(tmp_path, monkeypatch) -> dict[str, dict]:
    """Makers that write a line; how recorded motions were to be drawn, by picture."""
    drawn = {}

    def draw_recording(config, path, file, **asked):
        drawn[path.name] = {"file": file, **asked}
        path.write_text("a clip")

    makers = dict.fromkeys(MAKERS, lambda config, path: path.write_text("a picture"))
    monkeypatch.setattr(build_gallery, "MAKERS", makers | {RECORDED: MAKERS[RECORDED]})
    monkeypatch.setattr(build_gallery, "recorded_motion", draw_recording)
    monkeypatch.setattr(build_gallery, "UNPUBLISHED", tmp_path / "unpublished")
    return drawn


def test_without_a_recording_all_others_are_made(stubs, tmp_path):
    main(Gallery(out=tmp_path / "out"))
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert made == set(MAKERS) - {RECORDED}
    assert not stubs


@pytest.mark.parametrize("name", ["walk_poses.npz", FREE_FILE])
@pytest.mark.parametrize("only", [(), ("shapes.png",)])
def test_a_recording_goes_nowhere_near_the_pages_unasked(stubs, tmp_path, name, only):
    out, file = tmp_path / "out", tmp_path / name
    main(Gallery(only=only, recording=file, out=out))
    clip = f"{file.stem}.gif"
    assert [path.name for path in (tmp_path / "unpublished").iterdir()] == [clip]
    assert stubs == {clip: {"file": file}}
    assert tuple(path.name for path in out.glob("*")) == only


def test_where_recordings_go_git_does_not_look():
    assert UNPUBLISHED.relative_to(ROOT).parts[0] == "build"
    assert "build/" in (ROOT / ".gitignore").read_text().splitlines()


def test_the_free_recording_goes_into_the_pages_by_name(stubs, tmp_path):
    main(Gallery(only=(RECORDED,), recording=tmp_path / FREE_FILE, out=tmp_path / "out"))
    assert [path.name for path in (tmp_path / "out").iterdir()] == [RECORDED]
    assert not (tmp_path / "unpublished").exists()
    assert stubs[RECORDED]["recorded"] == "CMU, subject 01, motion 01"
    shown = stubs[RECORDED]["shown"]
    assert 3 * 60 <= shown.stop - shown.start <= 5 * 60


@pytest.mark.parametrize("name", ["walk_poses.npz", "02_04.bvh", None])
def test_another_recording_does_not_get_into_the_pages(stubs, tmp_path, name):
    file = name and tmp_path / name
    with pytest.raises(DsnetError, match=rf"expected CMU's {FREE_FILE}.*build/gallery"):
        main(Gallery(only=(RECORDED,), recording=file, out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
    assert not stubs


def test_an_unknown_picture_is_refused(tmp_path):
    with pytest.raises(DsnetError, match=r"--only x\.png; expected names among jumping_jacks\.gif"):
        main(Gallery(only=("x.png",), out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()
