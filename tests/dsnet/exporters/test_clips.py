"""Clips, opened again: rate, length, whose data it is, and what is seen in them."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.body.posing import shaped_joints
from bridge.motion import pack_theta, unpack_theta
from dsnet.exporters import clips
from dsnet.exporters.clip_pictures import ClipStage
from dsnet.pictures.panels import FOOTERS, footer
from dsnet.prediction.moving_body import MovingBody
from tests.dsnet.exporters.conftest import moving_body

FRAMES = 7


@pytest.fixture(scope="module")
def short(character):
    return moving_body(character, FRAMES)


def test_gif(short, tmp_path):
    path = tmp_path / "body.gif"
    clips.write_gif(path, short, body_px=120)
    with Image.open(path) as clip:
        count = getattr(clip, "n_frames", 1)
        assert (count, clip.size[0], clip.info["loop"]) == (3, 302, 0)
        assert clip.info["comment"].startswith(b"synthetic")
        durations_ms, pages = [], []
        for number in range(count):
            clip.seek(number)
            durations_ms.append(clip.info["duration"])
            pages.append(np.asarray(clip.convert("RGB")).astype(int))
    assert durations_ms == [50, 50, 50]
    assert path.stat().st_size < 3 * 30_000
    assert_bodies_side_by_side(pages[0], bar_px=62)
    assert (pages[0][35:60, :5] == 255).all()
    assert np.abs(pages[2] - pages[0]).max() > 100


def test_several_predictors_side_by_side(short, tmp_path):
    """A column each, on one scale of colours, in the order in which they are named."""
    path, motion = tmp_path / "body.gif", short.motion
    calm = MovingBody(short.trained, motion, gain=0.0)
    clips.write_gif(path, calm, short, body_px=120)
    with Image.open(path) as clip:
        assert clip.size[0] == 3 * 120 + 62
        assert clip.info["comment"].startswith(b"synthetic data; dsnet: dsnet_plus, dsnet_plus of")
        page = np.asarray(clip.convert("RGB")).astype(int)[30:-25]
    columns = [page[:, left : left + 120] for left in (0, 120, 240)]
    assert min((column.min(axis=-1) < 230).mean() for column in columns) > 0.05
    alone, still, moved = (np.quantile(np.ptp(column, axis=-1), 0.99) for column in columns)
    assert alone < 75 < still < moved


def test_a_recorded_motion_is_said_below_the_pictures(short, tmp_path):
    pages = []
    for recorded in ("", "somebody"):
        clips.write_gif(tmp_path / "body.gif", short, body_px=300, recorded=recorded)
        with Image.open(tmp_path / "body.gif") as clip:
            pages.append(np.asarray(clip.convert("RGB")).astype(int))
    differs = np.abs(pages[0] - pages[1]).max(axis=(1, 2)) > 100
    assert differs[-22:].any()
    assert not differs[:-22].any()
    said = f"{FOOTERS['synthetic']}; motion recorded: somebody"
    assert footer("synthetic", "somebody") == said
    assert footer("licensed", "somebody").startswith(FOOTERS["licensed"])


def assert_bodies_side_by_side(page, bar_px):
    """Skin on the left, colours on the right, and the footer's brown below."""
    height, width = page.shape[0], page.shape[1] - bar_px
    left, right = page[30:-25, : width // 2], page[30:-25, width // 2 : width]
    saturation = [np.ptp(half, axis=-1) for half in (left, right)]
    covered = [(half.min(axis=-1) < 230).mean() for half in (left, right)]
    assert min(covered) > 0.05
    assert np.quantile(saturation[0], 0.99) < 75 < np.quantile(saturation[1], 0.97)
    foot = page[height - 20 :].reshape(-1, 3)
    assert ((foot[:, 0] - foot[:, 2]) > 60).any()


def test_mp4(short, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    path = tmp_path / "body.mp4"
    clips.write_mp4(path, short, body_px=120)
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run([ffmpeg, "-i", str(path), *raw], capture_output=True, check=True)
    said = done.stderr.decode()
    assert "h264" in said
    assert "30 fps" in said
    assert re.search(r"comment +: synthetic data", said)
    (height,) = map(int, set(re.findall(r" 302x(\d+)", said)))
    pages = np.frombuffer(done.stdout, np.uint8).reshape(-1, height, 302, 3).astype(int)
    assert len(pages) == 4
    assert_bodies_side_by_side(pages[0], bar_px=62)


def test_an_encoder_that_fails_says_why(short, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    with pytest.raises(OSError, match="No such file or directory"):
        clips.write_mp4(tmp_path / "nowhere" / "body.mp4", short, body_px=20)


def test_every_body_of_the_motion_is_in_the_picture(performed):
    stage = ClipStage([performed.moving], step=2, width_px=400)
    camera = stage.camera
    target, half = camera.target_m, camera.pixel * camera.width_px / 2
    distance = np.linalg.norm(camera.away_m)
    back = camera.away_m / distance
    right = np.array([1.0, 0.0, 0.0])
    up = np.cross(back, right)
    for frame in range(0, len(performed.vertices_m), 2):
        for column in (0, 1):
            placed = stage.place(performed.vertices_m[frame], frame, column) - target
            depth = distance - placed @ back
            assert (np.abs(placed @ right) / depth).max() < half
            assert (np.abs(placed @ up) / depth).max() < half * camera.height_px / camera.width_px


def test_a_body_that_turned_and_went_away_is_drawn_where_it_was(short):
    (posed,) = short
    turn = Rotation.from_euler("y", 130, degrees=True)
    pose, trans_m = unpack_theta(short.motion.theta)
    pose = pose.copy()
    pose[:, 0] = (turn * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    joint_m = shaped_joints(short.body, short.motion.betas[None])[0, 0]
    trans_m = turn.apply(trans_m + joint_m) - joint_m + [20.0, 0.0, -7.0]
    motion = replace(short.motion, theta=pack_theta(pose, trans_m))
    elsewhere = MovingBody(short.trained, motion)
    (turned,) = elsewhere
    np.testing.assert_allclose(
        ClipStage([elsewhere], 2, 400).place(turned.vertices_m[3], 3, 1),
        ClipStage([short], 2, 400).place(posed.vertices_m[3], 3, 1),
        atol=2e-2,
    )


def test_a_gif_of_a_long_motion_is_refused(short, tmp_path, monkeypatch):
    monkeypatch.setattr(clips, "LONGEST_GIF_S", 0.05)
    with pytest.raises(DsnetError, match=r"--to gif of .* expected at most .* --to mp4"):
        clips.write_gif(tmp_path / "body.gif", short)
