"""How meshes move, the terms of the law of tissue, and what is learned of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.alignment.in_memory import InMemory
from bridge.motion import MotionSequence
from torch_align_ae.alignment import tissue
from torch_align_ae.alignment.corpus_fit import Window
from torch_align_ae.alignment.robust import summed
from torch_align_ae.alignment.skin_sample import SkinSample
from torch_align_ae.alignment.tissue import (
    GRAVITY_M_S2,
    Evidence,
    Loads,
    Observed,
    Tissue,
    accelerations,
    noise_variance,
    shared_noise,
)


@pytest.fixture(scope="module")
def observed(smpl):
    """Observe frames [start, stop) of the first two vertices, which move as `frames` (T, 2, 3)."""
    loads = Loads(SkinSample(smpl, 300))
    loads.sample = cast("SkinSample", SimpleNamespace(select=lambda meshes: meshes.transpose(1, 2)))
    loads.around = torch.eye(2, dtype=torch.float64)

    def observe(frames, start, stop):
        sequence = MotionSequence("a", "a", "", 0, len(frames), 60.0)
        meshes, seen = loads.observe(InMemory(frames), Window(sequence, start, stop))
        return meshes, seen.vertices, seen.acceleration, seen.jerk

    return observe


def falling(length: int) -> np.ndarray:
    """Two vertices, one in free fall, one moving steadily, at 60 fps."""
    time_s = np.arange(length) / 60
    frames = np.zeros((length, 2, 3))
    frames[:, 0, 1] = 1 - 9.81 / 2 * time_s**2
    frames[:, 1, 0] = 0.3 * time_s
    return frames


@pytest.mark.parametrize(("start", "stop"), [(0, 20), (0, 1), (19, 20), (5, 9), (0, 2), (18, 20)])
def test_accelerations_are_per_second_squared(observed, start, stop):
    frames = falling(20)
    meshes, vertices, acceleration, jerk = observed(frames, start, stop)
    np.testing.assert_allclose(meshes, frames[start:stop])
    np.testing.assert_allclose(vertices, frames[start:stop].transpose(0, 2, 1))
    expected = np.zeros((stop - start, 3, 2))
    expected[:, 1, 0] = -9.81
    np.testing.assert_allclose(acceleration, expected, atol=1e-8)
    np.testing.assert_allclose(jerk, np.zeros_like(expected), atol=1e-6)


def test_jerk_is_the_change_of_the_acceleration(observed):
    time_s = np.arange(20) / 60
    frames = np.zeros((20, 2, 3))
    frames[:, 1, 2] = 5 * time_s**3
    *_, jerk = observed(frames, 6, 12)
    expected = np.zeros((6, 3, 2))
    expected[:, 2, 1] = 30
    np.testing.assert_allclose(jerk, expected, atol=1e-7)


@pytest.mark.parametrize("length", range(1, 8))
def test_short_sequences(observed, length):
    frames, *seen = observed(falling(length), 0, length)
    assert frames.shape == (length, 2, 3)
    assert all(part.shape == (length, 3, 2) for part in seen)
    assert all(torch.isfinite(part).all() for part in seen)
    assert bool(seen[1].any()) == (length >= 3)


@given(st.integers(0, 10), st.integers(1, 11))
def test_parts_of_a_sequence_are_those_of_the_whole(observed, start, count):
    frames = np.random.default_rng(0).normal(size=(11, 2, 3))
    stop = min(start + count, 11)
    _, *whole = observed(frames, 0, 11)
    _, *part = observed(frames, start, stop)
    for ours, all_of_it in zip(part, whole, strict=True):
        np.testing.assert_array_equal(ours, all_of_it[start:stop])


def test_ends_take_their_neighbours_acceleration():
    frames = torch.randn(6, 2, 3, generator=torch.Generator().manual_seed(0))
    found = accelerations(frames, 60.0)
    torch.testing.assert_close(found[0], found[1])
    torch.testing.assert_close(found[-1], found[-2])
    torch.testing.assert_close(found[1], 3600 * (frames[2] - 2 * frames[1] + frames[0]))
    torch.testing.assert_close(found[2], 900 * (frames[4] - 2 * frames[2] + frames[0]))


@pytest.mark.parametrize("noise_m", [1e-4, 1e-3])
def test_noise_is_measured_beside_motion(noise_m):
    """All vertices swing together by centimetres, each with noise of its own."""
    time_s = torch.arange(40)[:, None, None] / 60
    moving = 0.05 * torch.sin(20 * time_s).expand(40, 3, 60)
    noise = noise_m * torch.randn(40, 3, 60, generator=torch.Generator().manual_seed(0))
    around = torch.full((60, 60), 1 / 60)
    assert noise_variance(moving, around) < 1e-14
    found = noise_variance(moving + noise, around)
    np.testing.assert_allclose(found, noise_m**2, rtol=0.1)
    assert noise_variance(noise[:4], around) == 0


def test_shared_noise_is_what_noise_and_its_acceleration_have_in_common():
    noise = torch.randn(4000, 3, 5, generator=torch.Generator().manual_seed(0))
    common = -(noise * accelerations(noise, 60.0)).sum(1).mean()
    np.testing.assert_allclose(common, shared_noise(1.0, 60.0), rtol=0.02)


@pytest.fixture(scope="module")
def load_of(sample, betas, lively, as_pose):
    """The loads (K, 3, 3, N) of three poses that are held or whose vertices move alike."""

    def of(acceleration=(0.0, 0.0, 0.0), *, upright=False):
        pose, trans = lively(3)
        frames = sample.shaped(betas).posed(as_pose(0 * pose if upright else pose, trans))
        moving = torch.tensor(acceleration)[None, :, None].expand(3, 3, len(sample))
        seen = Observed(torch.zeros_like(moving), moving, moving, 2 * moving)
        return Loads(sample).terms(seen, frames.turn), frames

    return of


def test_an_upright_body_that_stands_carries_nothing(load_of):
    assert load_of(upright=True)[0].abs().max() < 1e-5


def test_a_turned_limb_carries_the_difference_of_gravity(load_of, sample):
    (load, *_), frames = load_of()
    blended = torch.einsum("bkxy,kn->bxyn", frames.turn, sample.weights)
    gravity = torch.tensor([0.0, -GRAVITY_M_S2, 0.0])
    expected = torch.einsum("bxyn,y->bxn", blended, gravity) - gravity[:, None]
    torch.testing.assert_close(load, expected, rtol=0, atol=1e-5)
    assert load.norm(dim=1).max() > 10


def test_free_fall_takes_gravity_off(load_of):
    """What falls carries only what held its tissue up at rest, turned with the limb."""
    (load, *_), _ = load_of((0.0, -GRAVITY_M_S2, 0.0), upright=True)
    expected = torch.tensor([0.0, -GRAVITY_M_S2, 0.0])[None, :, None].expand_as(load)
    torch.testing.assert_close(load, expected, rtol=0, atol=1e-5)


def test_stiffening_bends_and_coupling_averages(load_of, monkeypatch):
    monkeypatch.setattr(tissue, "GRAVITY_M_S2", 0.0)
    (small, bent, around, late), _ = load_of((0.1, 0.0, 0.0))
    torch.testing.assert_close(small, torch.tensor([0.1, 0.0, 0.0])[:, None].expand_as(small))
    # Of springs that are twice as stiff at their own weight: x (1 + |2 x / g|^2) is the load.
    given = bent / 4
    stiffer = 1 + (2 * given.norm(dim=0) / 9.81).square()
    torch.testing.assert_close(given * stiffer, small, rtol=2e-3, atol=1e-6)
    torch.testing.assert_close(around, small, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(late, -2 * small)
    (large, bent, *_), _ = load_of((100.0, 0.0, 0.0))
    assert (bent[:, 0] < 0.6 * large[:, 0]).all()


def test_terms_hold_so_much_of_a_vertexs_own_noise(sample, monkeypatch):
    """What each term's product with the noise is, as a share of the acceleration's."""
    monkeypatch.setattr(tissue, "GRAVITY_M_S2", 0.0)
    law = Loads(sample)
    acceleration = 1e-3 * torch.randn(
        2000, 3, len(sample), generator=torch.Generator().manual_seed(0)
    )
    jerk = torch.zeros_like(acceleration)
    seen = Observed(jerk, acceleration, acceleration @ law.around, jerk)
    terms = law.terms(seen, torch.eye(3).expand(2000, 22, 3, 3))
    found = (terms * acceleration).sum((1, 2)) / acceleration.square().sum((0, 1)) * 2000
    shares = law.noise_in_common(terms)
    torch.testing.assert_close(shares / 2000, found / 2000, rtol=0.02, atol=0.05)


def draws(count: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(count, 3, 5, generator=torch.Generator().manual_seed(seed))


def converged(displacement, *terms, rounds=30):
    learned = Tissue.rigid(len(terms), torch.zeros(5))
    for _ in range(rounds):
        learned = Evidence.of(displacement, torch.stack(terms)).revise(learned)
    return learned


def test_newtons_law_is_found():
    acceleration = 10 * draws(20)
    compliance = torch.tensor([0.0, 1e-5, 1e-4, 1e-3, 2e-3])
    learned = converged(-compliance * acceleration, acceleration)
    torch.testing.assert_close(learned.compliance_s2[0], compliance, rtol=2e-3, atol=1e-9)
    assert learned.deviation_m.max() < 1e-4


def test_target_undoes_it():
    acceleration, still = 10 * draws(20), draws(20, seed=1)
    terms = torch.stack([acceleration, draws(20, seed=2)])
    learned = Tissue(torch.linspace(0, 1e-3, 10).view(2, 5), torch.zeros(5), torch.zeros(()))
    seen = still - learned.compliance_s2[0] * terms[0] - learned.compliance_s2[1] * terms[1]
    torch.testing.assert_close(learned.unloaded(seen, terms), still, rtol=0, atol=1e-6)


def test_terms_are_told_apart():
    first, second = 10 * draws(40), 10 * draws(40, seed=1)
    one, other = torch.linspace(0, 1e-3, 5), torch.linspace(2e-3, 0, 5)
    learned = converged(-one * first - other * second, first, second, first + second)
    both = learned.compliance_s2[:2] + learned.compliance_s2[2]
    torch.testing.assert_close(both, torch.stack([one, other]), rtol=0.01, atol=1e-5)
    assert learned.deviation_m.max() < 1e-4


def test_no_term_pulls_the_wrong_way():
    first = 10 * draws(40)
    second = first + 0.01 * draws(40, seed=1)
    learned = converged(1e-3 * (second - first), first, second)
    assert learned.compliance_s2.min() >= 0


def test_without_terms_only_the_weights_are_learned():
    displacement = 0.003 * draws(50)
    learned = Tissue.rigid(0, torch.zeros(5))
    none = torch.zeros(0, *displacement.shape)
    learned = Evidence.of(displacement, none).revise(learned)
    expected = displacement.square().sum(1).mean(0).sqrt()
    torch.testing.assert_close(learned.deviation_m, expected)
    torch.testing.assert_close(learned.unloaded(displacement, none), displacement)


def test_what_is_not_inertia_is_deviation():
    acceleration, other = 10 * draws(4000), 0.003 * draws(4000, seed=1)
    learned = converged(other, acceleration)
    assert learned.compliance_s2.max() < 1e-4
    root_mean_square = other.square().sum(1).mean(0).sqrt()
    torch.testing.assert_close(learned.deviation_m, root_mean_square, rtol=0.01, atol=0)


def test_flesh_that_runs_ahead_of_its_acceleration_is_not_believed():
    acceleration = draws(20)
    assert converged(1e-3 * acceleration, acceleration).compliance_s2.max() == 0


def test_no_motion_tells_nothing():
    learned = converged(0.001 * torch.ones(4, 3, 5), torch.zeros(4, 3, 5))
    assert learned.compliance_s2.max() == 0
    torch.testing.assert_close(learned.deviation_m, torch.full((5,), 0.001 * 3**0.5))


@given(st.integers(1, 9))
def test_evidence_may_come_in_portions(first):
    displacement, acceleration = draws(10), draws(10, seed=2)
    whole = Evidence.of(displacement, acceleration[None])
    halves = (slice(first), slice(first, None))
    parts = Evidence(*summed(Evidence.of(displacement[h], acceleration[None, h]) for h in halves))
    assert parts.frames == whole.frames == 10
    for name in ("gram", "pull", "displacement"):
        torch.testing.assert_close(getattr(parts, name), getattr(whole, name))


def test_noise_is_not_taken_for_softness():
    """Bone that shakes in the scanner: its noise, and the noise that its acceleration holds."""
    noise, other = draws(4000), draws(4000, seed=1)
    terms = (other - noise)[None]
    believed = Evidence.of(noise, terms)
    assert believed.revise(Tissue.rigid(1, torch.zeros(5))).compliance_s2.min() > 0.3
    in_common = torch.full((1, 5), 3.0 * 4000)
    sober = Evidence.of(noise, terms, in_common).revise(Tissue.rigid(1, torch.zeros(5)))
    assert sober.compliance_s2.max() < 0.05


def test_what_all_vertices_deviate_by_tells_nothing_where_there_is_noise():
    common_m, soft = 1e-3, torch.tensor([0.0, 0.0, 0.0, 1e-3, 3e-3])
    displacement = common_m * draws(20_000) + soft * draws(20_000, seed=1)
    none = torch.zeros(0, *displacement.shape)
    believed = Evidence.of(displacement, none)
    exact, noisy = (believed.revise(Tissue.rigid(0, torch.zeros(5), n)) for n in (0.0, 3e-4))
    expected = np.sqrt(3) * torch.sqrt(soft.square() + common_m**2)
    torch.testing.assert_close(exact.deviation_m, expected, rtol=0.02, atol=0)
    torch.testing.assert_close(noisy.deviation_m, np.sqrt(3) * soft, rtol=0.02, atol=2e-4)
    assert noisy.weights(1e-4)[:3].min() > 0.7 > 20 * noisy.weights(1e-4)[4]
    assert exact.weights(1e-4)[:3].max() < 0.01


def test_weights_fall_with_deviation_and_noise_widens_what_counts_half():
    learned = Tissue(torch.zeros(1, 3), torch.tensor([0.0, 1e-4, 1e-3]), torch.zeros(()))
    torch.testing.assert_close(learned.weights(1e-4), torch.tensor([1.0, 0.5, 1 / 101]))
    learned = Tissue(torch.zeros(0, 1), torch.tensor([5e-4]), torch.tensor(4e-4))
    torch.testing.assert_close(learned.weights(3e-4), torch.tensor([0.5]))
