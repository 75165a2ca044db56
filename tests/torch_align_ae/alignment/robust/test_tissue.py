from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from torch_align_ae.alignment.robust.tissue import Evidence, Tissue


def frames(count: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(count, 3, 5, generator=torch.Generator().manual_seed(seed))


def converged(displacement, *terms, rounds=30):
    tissue = Tissue.unknown(len(terms), torch.zeros(5))
    for _ in range(rounds):
        tissue = Evidence.of(displacement, torch.stack(terms)).revise(tissue)
    return tissue


def test_newtons_law_is_found():
    acceleration = 10 * frames(20)
    compliance = torch.tensor([0.0, 1e-5, 1e-4, 1e-3, 2e-3])
    tissue = converged(-compliance * acceleration, acceleration)
    torch.testing.assert_close(tissue.compliance_s2[0], compliance, rtol=2e-3, atol=1e-9)
    assert tissue.deviation_m.max() < 1e-4


def test_target_undoes_it():
    acceleration, still = 10 * frames(20), frames(20, seed=1)
    terms = torch.stack([acceleration, frames(20, seed=2)])
    tissue = Tissue(torch.linspace(0, 1e-3, 10).view(2, 5), torch.zeros(5), torch.zeros(()))
    seen = still - tissue.compliance_s2[0] * terms[0] - tissue.compliance_s2[1] * terms[1]
    torch.testing.assert_close(tissue.unloaded(seen, terms), still, rtol=0, atol=1e-6)


def test_terms_are_told_apart():
    first, second = 10 * frames(40), 10 * frames(40, seed=1)
    one, other = torch.linspace(0, 1e-3, 5), torch.linspace(2e-3, 0, 5)
    tissue = converged(-one * first - other * second, first, second, first + second)
    both = tissue.compliance_s2[:2] + tissue.compliance_s2[2]
    torch.testing.assert_close(both, torch.stack([one, other]), rtol=0.01, atol=1e-5)
    assert tissue.deviation_m.max() < 1e-4


def test_no_term_pulls_the_wrong_way():
    first = 10 * frames(40)
    second = first + 0.01 * frames(40, seed=1)
    tissue = converged(1e-3 * (second - first), first, second)
    assert tissue.compliance_s2.min() >= 0


def test_without_terms_only_the_weights_are_learned():
    displacement = 0.003 * frames(50)
    tissue = Tissue.unknown(0, torch.zeros(5))
    none = torch.zeros(0, *displacement.shape)
    tissue = Evidence.of(displacement, none).revise(tissue)
    expected = displacement.square().sum(1).mean(0).sqrt()
    torch.testing.assert_close(tissue.deviation_m, expected)
    torch.testing.assert_close(tissue.unloaded(displacement, none), displacement)


def test_what_is_not_inertia_is_deviation():
    acceleration, other = 10 * frames(4000), 0.003 * frames(4000, seed=1)
    tissue = converged(other, acceleration)
    assert tissue.compliance_s2.max() < 1e-4
    root_mean_square = other.square().sum(1).mean(0).sqrt()
    torch.testing.assert_close(tissue.deviation_m, root_mean_square, rtol=0.01, atol=0)


def test_flesh_that_runs_ahead_of_its_acceleration_is_not_believed():
    acceleration = frames(20)
    assert converged(1e-3 * acceleration, acceleration).compliance_s2.max() == 0


def test_no_motion_tells_nothing():
    tissue = converged(0.001 * torch.ones(4, 3, 5), torch.zeros(4, 3, 5))
    assert tissue.compliance_s2.max() == 0
    torch.testing.assert_close(tissue.deviation_m, torch.full((5,), 0.001 * 3**0.5))


@given(st.integers(1, 9))
def test_evidence_may_come_in_portions(first):
    displacement, acceleration = frames(10), frames(10, seed=2)
    whole = Evidence.of(displacement, acceleration[None])
    parts = Evidence.of(displacement[:first], acceleration[None, :first]) + Evidence.of(
        displacement[first:], acceleration[None, first:]
    )
    assert parts.frames == whole.frames == 10
    for name in ("gram", "pull", "displacement"):
        torch.testing.assert_close(getattr(parts, name), getattr(whole, name))


def test_weights_fall_with_deviation():
    tissue = Tissue(torch.zeros(1, 3), torch.tensor([0.0, 1e-4, 1e-3]), torch.zeros(()))
    torch.testing.assert_close(tissue.weights(1e-4), torch.tensor([1.0, 0.5, 1 / 101]))


def test_noise_is_not_taken_for_softness():
    """Bone that shakes in the scanner: its noise, and the noise that its acceleration holds."""
    noise, other = frames(4000), frames(4000, seed=1)
    terms = (other - noise)[None]
    believed = Evidence.of(noise, terms)
    assert believed.revise(Tissue.unknown(1, torch.zeros(5))).compliance_s2.min() > 0.3
    in_common = torch.full((1, 5), 3.0 * 4000)
    sober = believed.less_noise(in_common).revise(Tissue.unknown(1, torch.zeros(5)))
    assert sober.compliance_s2.max() < 0.05


def test_what_all_vertices_deviate_by_tells_nothing_where_there_is_noise():
    common_m, soft = 1e-3, torch.tensor([0.0, 0.0, 0.0, 1e-3, 3e-3])
    displacement = common_m * frames(20_000) + soft * frames(20_000, seed=1)
    none = torch.zeros(0, *displacement.shape)
    believed = Evidence.of(displacement, none)
    exact, noisy = (believed.revise(Tissue.unknown(0, torch.zeros(5), n)) for n in (0.0, 3e-4))
    expected = np.sqrt(3) * torch.sqrt(soft.square() + common_m**2)
    torch.testing.assert_close(exact.deviation_m, expected, rtol=0.02, atol=0)
    torch.testing.assert_close(noisy.deviation_m, np.sqrt(3) * soft, rtol=0.02, atol=2e-4)
    assert noisy.weights(1e-4)[:3].min() > 0.7 > 20 * noisy.weights(1e-4)[4]
    assert exact.weights(1e-4)[:3].max() < 0.01


def test_noise_widens_what_counts_half():
    tissue = Tissue(torch.zeros(0, 1), torch.tensor([5e-4]), torch.tensor(4e-4))
    torch.testing.assert_close(tissue.weights(3e-4), torch.tensor([0.5]))
