from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from benchmarks.alignment.convergence import ConvergenceConfig, main
from benchmarks.alignment.descent_rules import ClipSet, Rule, track
from benchmarks.alignment.known_clips import load_clips
from bridge.errors import DsnetError
from bridge.meshes.dyna_files import write_dyna
from bridge.motion import MotionSequence, pack_theta, to_manifest
from bridge.runs import ArtifactWriter, Run, write_artifact
from tests.one_thread import one_thread as one_thread
from torch_align_ae import SMPL
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.alignment.sgd import Descent, fit_pose

LENGTH = 4


@pytest.fixture(scope="module")
def smpl(body):
    return SMPL(body)


@pytest.fixture(scope="module")
def truth():
    """Of two subjects' clips: betas (2, 10), pose (8, 22, 3), trans (8, 3), offsets."""
    rise = torch.arange(2 * LENGTH)[:, None]
    pose, trans = torch.zeros(2 * LENGTH, 22, 3), 0.01 * rise * torch.ones(3)
    pose[:, 16, 2] = -1.0 + 0.02 * rise[:, 0]
    betas = torch.tensor([[0.5, *[0.0] * 9], [-0.5, *[0.0] * 9]])
    ripple = 0.002 * torch.sin(torch.arange(6890.0))[None, :, None]
    return betas, pose, trans, ripple * (1 + rise[..., None]).expand(-1, -1, 3)


@pytest.fixture
def run(tmp_path, monkeypatch, body, smpl, truth):
    """A run of these two clips."""
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    betas, pose, trans, offsets = truth
    meshes = smpl(betas.repeat_interleave(LENGTH, 0), pose, trans, offsets).numpy()
    index = [
        MotionSequence(f"{subject}_hips", subject, "hips", LENGTH * row, LENGTH, 60.0)
        for row, subject in enumerate(("50004", "50020"))
    ]
    found = Run("t")
    writer = ArtifactWriter(found.path / "corpus", "corpus", data="synthetic")
    body.save_smpl_npz(writer.file_path("SMPL_FEMALE.npz"))
    with write_dyna(writer.file_path("dyna_female.h5"), body.faces) as add:
        for sequence in index:
            add(sequence.name, meshes[sequence.frames])
    writer.finish()
    write_artifact(
        found.path / "truth",
        "truth",
        {"betas": betas, "theta": pack_theta(pose, trans), "offsets": offsets.contiguous()},
        units={"betas": "1", "theta": "rad and m", "offsets": "m"},
        data="synthetic",
        sequences=to_manifest(index),
    )
    return found


def test_the_truth_has_no_errors(run, truth):
    smpl, known = load_clips(run, ["50020_hips", "50004_hips"], slice(1, 3))
    assert known.betas[:, 0].tolist() == [-0.5, 0.5]
    pose, trans = (part.view(2, LENGTH, -1)[[1, 0], 1:3] for part in truth[1:3])
    errors = known.errors(smpl, known.betas, pose.unflatten(-1, (22, 3)), trans)
    assert errors["r2"] == pytest.approx(1.0, abs=1e-6)
    assert errors["pose_deg"] == pytest.approx(0.0, abs=1e-4)
    off = known.errors(smpl, known.betas, pose.unflatten(-1, (22, 3)) + 0.01, trans)
    assert off["r2"] < 0.9
    assert off["pose_deg"] > 0.5


def test_frames_beyond_the_end(run):
    with pytest.raises(DsnetError, match="50004_hips"):
        load_clips(run, ["50004_hips"], slice(1, LENGTH + 1))


@pytest.fixture
def clips(smpl, truth):
    """Two frames of both clips without offsets, from a pose that is a degree off."""
    betas, pose, trans, _ = truth
    objective = MeshDistance(smpl)
    meshes = objective.arrange(smpl(betas.repeat_interleave(LENGTH, 0), pose, trans))
    targets = meshes.view(2, LENGTH, -1).transpose(0, 1)
    start = pose.view(2, LENGTH, 22, 3)[:, 0] + 0.02, trans.view(2, LENGTH, 3)[:, 0]
    return ClipSet(objective.shapes(betas), targets[1:3], *start)


def test_a_fixed_number_of_steps_is_the_stages_own_descent(clips):
    pose, trans = clips.pose, clips.trans
    for target in clips.targets:
        pose, trans = fit_pose(clips.shapes, (pose, trans), target, 9, Descent())
    found = track(clips, Rule(9), Descent())
    np.testing.assert_allclose(found.pose[:, -1], pose, atol=1e-5)
    np.testing.assert_allclose(found.trans[:, -1], trans, atol=1e-5)
    assert (found.steps == 9).all()


def test_patience_ends_a_frame(clips):
    soon = track(clips, Rule(100, patience=2), Descent())
    late = track(clips, Rule(100, patience=20), Descent())
    assert (soon.steps < late.steps).all()


def test_endless_patience_is_a_fixed_number_of_steps(clips):
    found = track(clips, Rule(12, patience=12), Descent())
    expected = track(clips, Rule(12), Descent())
    np.testing.assert_array_equal(found.pose, expected.pose)


def test_a_falling_rate_comes_closer(clips, smpl, truth):
    def distance(rule):
        found = track(clips, rule, Descent())
        posed = smpl(truth[0], found.pose[:, -1], found.trans[:, -1])
        return (clips.shapes.objective.arrange(posed) - clips.targets[-1]).norm(dim=1).mean()

    assert distance(Rule(120, decays=True)) < 0.5 * distance(Rule(120))


def test_results(run, tmp_path):
    config = ConvergenceConfig(
        out=tmp_path / "out",
        run="t",
        subjects=("50004", "50020"),
        motions=("hips",),
        start=1,
        frames=2,
        steps=(2, 4),
        decayed_steps=(3,),
        patience=(2,),
        most_steps=5,
        first_frame_steps=20,
        shape_steps=20,
    )
    rows = main(config)["rules"]
    kinds = [(row["kind"], row["steps"], row["betas"]) for row in rows]
    assert kinds == [
        (*rule, betas)
        for rule in (("fixed", 2), ("fixed", 4), ("decayed", 3), ("patience", 5))
        for betas in ("true", "frame 1")
    ]
    stored = json.loads((tmp_path / "out" / "convergence.json").read_text())
    assert (stored["rules"], stored["data"]) == (rows, "synthetic")
    assert "torch" in stored["provenance"]["versions"]
