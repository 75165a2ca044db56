"""The terms of the law against what they are for a body that stands, turns and falls."""

from __future__ import annotations

import pytest
import torch

from torch_align_ae.alignment.robust import loads
from torch_align_ae.alignment.robust.loads import GRAVITY_M_S2, Loads, Observed


@pytest.fixture(scope="module")
def load_of(sample, betas, lively, as_pose):
    """The loads (K, 3, 3, N) of three poses that are held or whose vertices move alike."""

    def of(acceleration=(0.0, 0.0, 0.0), *, upright=False):
        pose, trans = lively(3)
        frames = sample.frames(sample.shaped(betas), as_pose(0 * pose if upright else pose, trans))
        moving = torch.tensor(acceleration)[None, :, None].expand(3, 3, len(sample))
        seen = Observed(torch.zeros_like(moving), moving, moving, 2 * moving)
        return Loads.of(sample).terms(seen, frames.turn), frames

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
    monkeypatch.setattr(loads, "GRAVITY_M_S2", 0.0)
    (small, bent, around, late), _ = load_of((0.1, 0.0, 0.0))
    torch.testing.assert_close(small, torch.tensor([0.1, 0.0, 0.0])[:, None].expand_as(small))
    torch.testing.assert_close(bent, small, rtol=1e-4, atol=0)
    torch.testing.assert_close(around, small, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(late, -2 * small)
    (large, bent, *_), _ = load_of((100.0, 0.0, 0.0))
    assert (bent[:, 0] < 0.05 * large[:, 0]).all()


def test_terms_hold_so_much_of_a_vertexs_own_noise(sample, monkeypatch):
    """What each term's product with the noise is, as a share of the acceleration's."""
    monkeypatch.setattr(loads, "GRAVITY_M_S2", 0.0)
    law = Loads.of(sample)
    acceleration = 1e-3 * torch.randn(
        2000, 3, len(sample), generator=torch.Generator().manual_seed(0)
    )
    jerk = torch.zeros_like(acceleration)
    seen = Observed(jerk, acceleration, acceleration @ law.around, jerk)
    terms = law.terms(seen, torch.eye(3).expand(2000, 22, 3, 3))
    found = (terms * acceleration).sum((1, 2)) / acceleration.square().sum((0, 1)) * 2000
    shares = law.noise_in_common(terms)
    torch.testing.assert_close(shares / 2000, found / 2000, rtol=0.02, atol=0.05)
