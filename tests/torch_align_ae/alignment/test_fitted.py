from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.runs import ArtifactWriter
from torch_align_ae.alignment.fitted import AlignedFiles, Fitted, measure

SEQUENCES = [
    MotionSequence("50004_hips", "50004", "hips", 0, 4, 60.0),
    MotionSequence("50020_knees", "50020", "knees", 4, 3, 60.0),
]


@pytest.fixture
def fitted(smpl, motion):
    """Frames 1 and 2 of the second sequence, off by a centimetre."""
    pose, trans = motion(2)
    betas = torch.zeros(10)
    mesh = smpl(betas.expand(2, -1), pose, trans) + torch.tensor([0.0, 0.01, 0.0])
    return measure(smpl, 1, 1, betas, pose, trans, mesh), mesh


def test_offsets_explain_the_mesh(fitted, smpl):
    found, mesh = fitted
    posed = smpl(torch.zeros(2, 10), found.pose, found.trans, found.offsets)
    np.testing.assert_allclose(posed, mesh, atol=1e-5)
    np.testing.assert_allclose(found.frame_error, 0.01, atol=1e-5)


def test_rows_beyond_the_mesh_are_cut_off(fitted, smpl, motion):
    found, mesh = fitted
    pose, trans = motion(5)
    again = measure(smpl, 1, 1, torch.zeros(10), pose, trans, mesh)
    np.testing.assert_array_equal(again.pose, found.pose)
    np.testing.assert_array_equal(again.offsets, found.offsets)


def test_rows_land_behind_the_sequences_before(fitted, tmp_path):
    found: Fitted = fitted[0]
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    poses = AlignedFiles.of(writer, SEQUENCES, 6890).store(SEQUENCES[1], found)
    theta, offsets, frame_error = (
        np.load(writer.file_path(f"{name}.npy")) for name in ("theta", "offsets", "frame_error")
    )
    assert (theta.shape, offsets.shape, frame_error.shape) == ((7, 69), (7, 6890, 3), (7,))
    np.testing.assert_array_equal(poses.pose, found.pose)
    assert (poses.track, poses.start) == (1, 1)
    np.testing.assert_array_equal(offsets[5:], found.offsets)
    np.testing.assert_array_equal(frame_error[5:], found.frame_error)
    assert not offsets[:5].any()


def test_opened_again_it_keeps_what_was_written(fitted, tmp_path):
    found: Fitted = fitted[0]
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    AlignedFiles.of(writer, SEQUENCES, 6890).store(SEQUENCES[1], found)
    AlignedFiles.of(writer, SEQUENCES, 6890)
    offsets = np.load(writer.file_path("offsets.npy"))
    np.testing.assert_array_equal(offsets[5:], found.offsets)


@pytest.mark.parametrize("bad", [0.3, float("inf"), float("nan")])
def test_a_frame_that_fits_no_body_is_named_and_not_stored(fitted, tmp_path, bad):
    found: Fitted = fitted[0]
    spoilt = replace(found, frame_error=torch.tensor([0.1, bad]))
    writer = ArtifactWriter(tmp_path / "align", "align", data="synthetic")
    files = AlignedFiles.of(writer, SEQUENCES, 6890)
    with pytest.raises(DsnetError, match="50020_knees, whose frame 2 stays"):
        files.store(SEQUENCES[1], spoilt)
    assert not np.load(writer.file_path("offsets.npy")).any()
