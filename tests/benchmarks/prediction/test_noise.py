"""Noise is what a recording has besides its calm self, and the page is its numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.prediction import noise
from benchmarks.prediction.recorded_noise import Noise
from bridge.errors import DsnetError
from bridge.motion import load_motion, unpack_theta
from tests.forged.amass import save, smplh

PAGE = Path(__file__).parents[3] / "docs" / "results" / "prediction" / "noise.md"
FRAMES, FPS = 240, 60.0


def recording(folder: Path, hertz: float, size: float) -> Path:
    """A file of somebody who sways at 1 Hz and trembles about an elbow and along x."""
    time_s = np.arange(FRAMES) / FPS
    sway, tremor = (np.sin(2 * np.pi * f * time_s) for f in (1.0, hertz))
    arrays = smplh(FRAMES, FPS)
    arrays["poses"][:, 3 * 18] = 0.4 * sway + 10 * size * tremor
    arrays["trans"][:, 0] = 0.1 * sway + size * tremor
    return save(folder / "recording.npz", arrays)


def test_a_recording_is_its_calm_self_and_its_noise(tmp_path):
    path = recording(tmp_path, 20.0, 1e-3)
    noise = Noise.of(path)
    calm = unpack_theta(load_motion(path, smooth_hz=8.0).theta)
    whole = unpack_theta(load_motion(path).theta)
    for found, expected in zip(noise.added(*calm), whole, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)
    inside = slice(20, -20)  # a filter's ends know one side only
    tremor = np.sin(2 * np.pi * 20.0 * np.arange(FRAMES) / FPS)
    np.testing.assert_allclose(noise.turns[inside, 18, 0], 1e-2 * tremor[inside], atol=1e-3)
    others = np.delete(noise.turns, 18, axis=1)
    assert np.abs(others).max() < 1e-9


def test_who_trembles_not_has_no_noise(tmp_path):
    found = Noise.of(recording(tmp_path, 20.0, 0.0))
    assert np.abs(found.turns[20:-20]).max() < 1e-3
    assert np.abs(found.steps_m[20:-20]).max() < 2e-4


def test_noise_goes_on_without_a_leap_in_longer_motions(tmp_path):
    found = Noise.of(recording(tmp_path, 20.0, 1e-3))
    frames = 2 * FRAMES + 50
    pose, trans_m = found.added(np.zeros((frames, 22, 3)), np.zeros((frames, 3)))
    np.testing.assert_allclose(trans_m[:FRAMES], found.steps_m)
    np.testing.assert_allclose(trans_m[FRAMES : 2 * FRAMES], found.steps_m[::-1])
    steps_rad = Rotation.from_rotvec(pose[1:, 18]).inv() * Rotation.from_rotvec(pose[:-1, 18])
    within = np.linalg.norm(np.diff(found.turns[:, 18], axis=0), axis=1).max()
    assert steps_rad.magnitude().max() <= within + 1e-9


def test_scores_are_kept_for_the_same_cutoffs_alone(tmp_path, monkeypatch):
    recording(tmp_path, 20.0, 1e-3)
    out, made = tmp_path / "noise.json", []

    def clips(run, _, cutoffs):
        made.append((run.name, cutoffs))
        return [{"scores": {cutoff: {} for cutoff in cutoffs}}]

    monkeypatch.setattr(noise, "_clips", clips)
    for cutoffs in (("none", "8"), ("none", "8"), ("none", "stream")):
        noise.main(noise.NoiseConfig(out, ("demo",), tmp_path, cutoffs))
    assert made == [("demo", ("none", "8")), ("demo", ("none", "stream"))]
    (kept,) = json.loads(out.read_text())["runs"]["demo"]
    assert [*kept["scores"]] == ["none", "stream"]


def test_energies_are_summed_up_by_cutoff_and_input(tmp_path):
    def clip(clean: tuple[float, float], noisy: tuple[float, float]) -> dict:
        scores = {
            name: {"offsets": list(parts), "velocity": [2 * parts[0], parts[1]]}
            for name, parts in (("clean", clean), ("noisy", noisy), ("white", noisy))
        }
        return {"scores": {"none": scores}, "tremor_mm": {"clean": 0.1, "noisy": 0.9}}

    clips = [clip((1.0, 10.0), (5.0, 10.0)), clip((1.0, 30.0), (3.0, 30.0))]
    path = tmp_path / "noise.json"
    path.write_text(json.dumps({"runs": {"r": clips}, "recordings": 3, "command": "the command"}))
    page = noise.markdown(path)
    assert (
        "| `r` | none | 0.950 | 0.900 | 0.900 | 0.800 | 0.500 | 0.600 | 0.800 | 0.500 | 0.600 |"
        in page
    )
    assert "how many of them:\nnone: 2." in page
    assert "by 0.9 to\n0.9 mm above 10 Hz (median 0.9), the clean ones by at most 0.1" in page


def test_a_folder_without_recordings_is_one_line(tmp_path):
    config = noise.NoiseConfig(tmp_path / "noise.md", ("demo",), tmp_path)
    with pytest.raises(DsnetError, match=r"without \.bvh or \.npz"):
        noise.main(config)
    assert not config.out.exists()


def test_the_committed_page_is_made_of_its_numbers():
    assert PAGE.read_text() == noise.markdown(PAGE.with_suffix(".json"))


def test_the_table_of_streams_is_made_of_its_numbers():
    text = (PAGE.parents[2] / "prediction.md").read_text(encoding="utf-8")
    table = text.partition("<!-- streams -->\n")[2].partition("\n<!-- end of streams -->")[0]
    assert table == noise.streams_table(PAGE.with_name("noise_streams.json"))
