"""What both aligners write: where rows land, what is refused, when written rows still hold."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.runs import ArtifactWriter
from torch_align_ae.alignment.corpus_fit import AlignedFiles, Window, windows

SEQUENCES = [
    MotionSequence("50004_hips", "50004", "hips", 0, 4, 60.0),
    MotionSequence("50020_knees", "50020", "knees", 4, 3, 60.0),
]
# Frames 1 and 2 of the second sequence.
WINDOW = Window(SEQUENCES[1], 1, 3)


class MovingMeshes:
    """Of somebody who goes a centimetre a frame."""

    def __init__(self, at: np.ndarray) -> None:
        self.at = at

    def read(self, start: int, stop: int, every: int = 1) -> np.ndarray:
        along_m = 0.01 * self.at[start:stop, None, None]
        return (along_m * np.ones((6890, 3))[::every]).astype(np.float32)


@pytest.fixture
def writer(tmp_path):
    return ArtifactWriter(tmp_path / "align", "align", data="synthetic")


@pytest.fixture
def files(writer):
    return AlignedFiles.of(writer, 7, 6890)


@pytest.fixture
def fitted(smpl, motion):
    """Shape, poses and meshes of `WINDOW`, off by a centimetre."""
    pose, trans = motion(2)
    betas = torch.zeros(10)
    mesh = smpl(betas.expand(2, -1), pose, trans) + torch.tensor([0.0, 0.01, 0.0])
    return betas, pose, trans, mesh


def test_windows_cover_every_frame_once():
    assert [(w.start, w.stop) for w in windows(SEQUENCES[0], 3)] == [(0, 3), (3, 4)]
    assert WINDOW.rows == slice(5, 7)


def test_rows_land_behind_the_sequences_before_and_explain_the_mesh(fitted, files, writer, smpl):
    betas, pose, trans, mesh = fitted
    files.store(smpl, WINDOW, *fitted)
    theta, offsets, frame_error = (
        np.load(writer.file_path(f"{name}.npy")) for name in ("theta", "offsets", "frame_error")
    )
    assert (theta.shape, offsets.shape, frame_error.shape) == ((7, 69), (7, 6890, 3), (7,))
    posed = smpl(betas.expand(2, -1), pose, trans, torch.from_numpy(offsets[5:]))
    np.testing.assert_allclose(posed, mesh, atol=1e-5)
    np.testing.assert_allclose(frame_error[5:], 0.01, atol=1e-5)
    assert not offsets[:5].any()


def test_opened_again_it_keeps_what_was_written_and_knows_its_digest(fitted, files, writer, smpl):
    nothing = files.digest([WINDOW])
    files.store(smpl, WINDOW, *fitted)
    written = files.digest([WINDOW])
    assert nothing != written == AlignedFiles.of(writer, 7, 6890).digest([WINDOW])
    files.theta.write(6, np.ones((1, 69)))
    assert files.digest([WINDOW]) != written


@pytest.mark.parametrize("bad", [0.3, float("inf"), float("nan")])
def test_a_frame_that_fits_no_body_is_named_and_not_stored(fitted, files, writer, smpl, bad):
    betas, pose, trans, mesh = fitted
    mesh[1] += bad
    with pytest.raises(DsnetError, match="50020_knees, whose frame 2 stays"):
        files.store(smpl, WINDOW, betas, pose, trans, mesh)
    assert not np.load(writer.file_path("offsets.npy")).any()


def test_what_nobodys_meshes_are_is_told(writer):
    """An honest sequence says nothing; one of another rate, head down, of two people, or with
    meshes that repeat, does."""
    odd, files = (
        MotionSequence("s_1_jump", "s", "1_jump", 0, 40, 60.0),
        AlignedFiles.of(writer, 40, 1),
    )
    meshes = MovingMeshes(np.arange(40.0))
    hop_m = 0.4 * np.abs(np.sin(np.linspace(0.0, np.pi, 40)))  # 40 frames in the air: 0.4 m
    theta = np.zeros((40, 69))
    theta[:, 67] = hop_m
    files.theta.write(0, theta)
    files.frame_error.write(0, np.full(40, 0.02))
    assert list(files.warnings(odd, meshes, 0.03)) == []
    theta[:, 67] = 4 * hop_m
    theta[:, 0] = np.pi
    files.theta.write(0, theta)
    files.frame_error.write(0, np.full(40, 0.04))
    meshes.at[20:23] = 19
    fall, again, down, apart = files.warnings(odd, meshes, 0.03)
    assert fall.startswith("s_1_jump falls with 3.8 times gravity at 60 frames a second")
    assert "repeats 3 of its 40 meshes while the body moves, first number 20" in again
    assert "is head down" in down
    assert apart.startswith("s_1_jump stays 4 cm from SMPL")
