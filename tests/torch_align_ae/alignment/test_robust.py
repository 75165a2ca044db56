"""The robust aligner on tissue that is simulated, where the truth is known, and as a stage."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.alignment.in_memory import align_sequences
from benchmarks.alignment.lesser_laws import WeightsAlone
from benchmarks.laws.captured import CapturedForm
from bridge.motion import MotionSequence, unpack_theta
from bridge.runs import Run, workers
from bridge.tissue.oscillators import node_loads
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.simulation import TissueSimulator, posed_meshes
from dsnet.synthetic.subjects import SUBJECTS
from torch_align_ae.alignment import tissue
from torch_align_ae.alignment.gauss_newton import fit_shape
from torch_align_ae.alignment.robust import RobustFit, RobustSettings, evenly_spaced_clips
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.alignment.stage_align import AlignConfig, main
from torch_align_ae.alignment.tissue import Loads, Tissue
from torch_align_ae.body import rest_pose_offsets
from torch_align_ae.body.rotations import axis_angle_to_matrix, matrix_to_axis_angle

FRAMES = 72
SETTINGS = RobustSettings.fast()
# Her flesh hangs: it moves twice as far as when it stiffened about the standing shape. Poses and
# shapes were found twice as well then; bounds are beside what is found now.


@pytest.fixture(scope="module")
def jump(body):
    """The heaviest woman jumps: meshes (T, V, 3), true offsets, theta and betas."""
    subject = SUBJECTS["female"][0]
    skeleton = Skeleton(body, subject.betas)
    theta = perform(
        "one_leg_jump", subject.name, skeleton, frame_count=FRAMES, fps=60.0, seed=3
    ).astype(np.float32)
    moving = theta.astype(np.float64)
    offsets = TissueSimulator(body, subject.betas).offsets(moving, 60.0)
    meshes = posed_meshes(body, subject.betas, moving, offsets).astype(np.float32)
    return meshes, offsets, theta, subject.betas


def recovered(smpl, jump, law=Loads):
    """R2 of the offsets and mean pose error in degrees."""
    return scores(smpl, jump, *align_sequences(smpl, [jump[0]], [0], SETTINGS, law=law))


def scores(smpl, jump, betas, thetas):
    meshes, offsets, theta, _ = jump
    (found,) = thetas
    pose, trans = (torch.from_numpy(part.copy()) for part in unpack_theta(found))
    shapes = torch.from_numpy(betas).expand(len(meshes), -1)
    ours, _ = rest_pose_offsets(smpl, torch.from_numpy(meshes), shapes, pose, trans)
    true_pose = torch.from_numpy(unpack_theta(theta)[0].copy())
    between = axis_angle_to_matrix(pose).mT @ axis_angle_to_matrix(true_pose)
    error_deg = matrix_to_axis_angle(between).norm(dim=-1).rad2deg().mean().item()
    return 1 - np.square(ours.numpy() - offsets).sum() / np.square(offsets).sum(), error_deg


@pytest.fixture(scope="module")
def aligned(smpl, jump):
    """Shape, and the pose of each frame, of the jump."""
    return align_sequences(smpl, [jump[0]], [0], SETTINGS)


def test_dynamics_are_given_back(smpl, jump, aligned):
    r2, error_deg = scores(smpl, jump, *aligned)
    assert r2 > 0.99
    assert error_deg < 0.35


def test_shape_is_corrected_for_what_hangs(smpl, jump, aligned):
    meshes, *_, true_betas = jump
    found, _ = aligned
    sample = SkinSample(smpl, SETTINGS.vertices)
    of_frame_1 = fit_shape(sample, sample.select(torch.from_numpy(meshes[:1])), 8).numpy()
    # Her tissue hangs in every frame, and the law does not know everything about how.
    np.testing.assert_allclose(found[0], true_betas, atol=0.03)
    assert np.abs(found - true_betas).max() < np.abs(of_frame_1 - true_betas).max() / 4


def test_each_load_does_something(smpl, jump, aligned, monkeypatch):
    whole = scores(smpl, jump, *aligned)[0]
    assert recovered(smpl, jump, WeightsAlone)[0] < whole - 0.02
    monkeypatch.setattr(tissue, "GRAVITY_M_S2", 0.0)
    assert recovered(smpl, jump)[0] < whole - 0.001


@pytest.fixture(scope="module")
def held(body, jump):
    """Poses that are held, upright and in any other orientation, each a sequence of its own."""
    betas = jump[3]
    generator = np.random.default_rng(1)
    theta = np.zeros((8, 69))
    theta[:, :3] = 1.5 * generator.standard_normal((8, 3))
    theta[0, :3] = 0
    theta[:, 48:66] = 0.5 * generator.standard_normal((8, 18))
    simulator = TissueSimulator(body, betas)
    still = np.repeat(theta[:, None], 3, axis=1)
    offsets = np.stack([simulator.offsets(motion, 60.0) for motion in still])
    meshes = [posed_meshes(body, betas, *one) for one in zip(still, offsets, strict=True)]
    return meshes, offsets


def test_a_body_that_hangs_still_is_found_in_any_orientation(smpl, held, monkeypatch):
    """Nothing moves, so only gravity can tell what is flesh and what is pose."""
    meshes, offsets = held

    def wrong():
        betas, found = align_sequences(smpl, meshes, [0] * len(meshes), SETTINGS)
        shapes = torch.from_numpy(betas)
        squares = 0.0
        for mesh, own, true in zip(meshes, found, offsets, strict=True):
            pose, trans = (torch.from_numpy(part[:1].copy()) for part in unpack_theta(own))
            ours, _ = rest_pose_offsets(smpl, torch.from_numpy(mesh[:1]), shapes, pose, trans)
            squares += np.square(ours.numpy() - true[:1]).sum()
        return squares / np.square(offsets[:, 0]).sum()

    # Eight poses say little about how each vertex stiffens.
    assert wrong() < 0.16
    monkeypatch.setattr(tissue, "GRAVITY_M_S2", 0.0)
    assert wrong() > 0.3


def test_results_do_not_depend_on_the_number_of_cores(smpl, jump, monkeypatch):
    meshes = jump[0][:40]
    few = RobustSettings(vertices=300, steps=2, calibration_frames=40, calibration_rounds=2)
    betas, (theta,) = align_sequences(smpl, [meshes], [0], few)
    monkeypatch.setattr(workers, "usable_cores", lambda: 1)
    again_betas, (again,) = align_sequences(smpl, [meshes], [0], few)
    np.testing.assert_array_equal(betas, again_betas)
    np.testing.assert_array_equal(theta, again)


def test_a_lone_frame_is_aligned(smpl, jump):
    few = RobustSettings(vertices=300, steps=3, calibration_frames=8, calibration_rounds=1)
    betas, (theta,) = align_sequences(smpl, [jump[0][:1]], [0], few)
    # One frame cannot tell what hangs from the shape.
    np.testing.assert_allclose(betas[0], jump[3], atol=0.75)
    np.testing.assert_allclose(theta[0], jump[2][0], atol=0.1)


def test_noise_costs_little(smpl, jump):
    """Half a millimetre of scanner noise: poses come from 400 vertices, noise from each alone."""
    meshes, offsets, theta, betas = jump
    noise = 5e-4 * np.random.default_rng(0).standard_normal(meshes.shape)
    noisy = (meshes + noise).astype(np.float32), offsets + noise, theta, betas
    r2, error_deg = recovered(smpl, noisy)
    assert r2 > 0.9
    assert error_deg < 0.85


def test_registrations_keep_a_landings_accelerations(smpl, jump, monkeypatch):
    """Where bone deviates as much as flesh does, poses that follow the flesh land too softly."""
    _, offsets, theta, true_betas = jump
    moving = theta.astype(np.float64)
    form = CapturedForm(smpl.data, seed=4)
    whole = offsets + form.static("50004", moving)
    exact = posed_meshes(smpl.data, true_betas, moving, whole.astype(np.float32))
    registered = form.registered("50004_one_leg_jump", exact, 60.0)
    thighs = np.flatnonzero(smpl.data.weights[:, [1, 2]].max(1) > 0.99)[::20]
    felt = node_loads(smpl.data, thighs, true_betas, moving, 60.0).inertia

    def kept() -> float:
        """Share of the thighs' accelerations, 6 to 15 Hz, that the found poses have."""
        betas, (found,) = align_sequences(smpl, [registered], [0], SETTINGS)
        seen = node_loads(smpl.data, thighs, betas[0], found.astype(np.float64), 60.0).inertia
        hz = np.fft.rfftfreq(FRAMES, 1 / 60)
        there, here = (np.fft.rfft(x, axis=0)[(hz > 6) & (hz < 15)] for x in (felt, seen))
        return float((here * there.conj()).real.sum() / np.square(np.abs(there)).sum())

    found = kept()
    # 0.97 while flesh moved half as far: here the aligner has lost something.
    assert 0.7 < found < 1.05
    rigid = Tissue.rigid
    monkeypatch.setattr(Tissue, "rigid", lambda terms, weights, _: rigid(terms, weights, 0.0))
    assert kept() < found


def sequence(length: int) -> MotionSequence:
    return MotionSequence("a", "a", "", 0, length, 60.0)


def test_clips_are_spread_over_all_recordings():
    clips = list(evenly_spaced_clips([sequence(length) for length in (100, 3, 60, 40)], 96))
    assert sum(stop - start for _, start, stop in clips) <= 96
    assert all(0 <= start < stop <= own.length for own, start, stop in clips)
    assert {own.length for own, *_ in clips} >= {100, 60, 40}
    assert [(start, stop) for _, start, stop in evenly_spaced_clips([sequence(1)], 96)] == [(0, 1)]


FEW = RobustSettings(vertices=300, steps=3, calibration_frames=16, calibration_rounds=3)


@pytest.fixture
def config(corpus, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    folder = corpus[0]
    return AlignConfig(
        run="t",
        smpl=folder / "SMPL_FEMALE.npz",
        dyna=(folder / "dyna.h5",),
        aligner="robust",
        robust=FEW,
    )


def arrays_of(config):
    main(config)
    artifact = Run(config.run).artifact("align")
    return artifact, {name: np.array(artifact.array(name)) for name in artifact.manifest["arrays"]}


def test_resuming_ends_with_the_same_bytes(config, monkeypatch):
    _, whole = arrays_of(config)
    fit_frames, calls = RobustFit.fit_frames, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) > 2:
            raise KeyboardInterrupt
        return fit_frames(*arguments)

    other = AlignConfig(**{**vars(config), "run": "u"})
    monkeypatch.setattr(RobustFit, "fit_frames", interrupted)
    with pytest.raises(KeyboardInterrupt):
        main(other)
    monkeypatch.setattr(RobustFit, "fit_frames", fit_frames)
    monkeypatch.setattr(RobustFit, "calibrate", None)  # subjects are not learned twice
    _, resumed = arrays_of(other)
    assert whole.keys() == resumed.keys()
    for name, array in whole.items():
        np.testing.assert_array_equal(resumed[name], array, err_msg=name)
