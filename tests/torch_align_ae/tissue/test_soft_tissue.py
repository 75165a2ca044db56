"""The PyTorch layer of `dsnet_plus`: values, gradients, pieces, and beside smplx."""

from __future__ import annotations

import pickle
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

import dsnet
from benchmarks.other_bodies import renumbered
from bridge.body import BodyModelData, load_body_model
from bridge.errors import DsnetError
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel, predict_whole
from tests.forged.other_bodies import with_pelvis_off
from torch_align_ae import SMPL, SoftTissue
from torch_align_ae.tissue import soft_tissue

PEOPLE = torch.tensor([[0.5, -1.0, 0, 0, 0, 0, 0, 0, 0, 0], [-1.0, 0.5, 1, 0, 0, 0, 0, 0, 0, 0]])


@pytest.fixture(scope="module")
def plus() -> PlusModel:
    model = load_model("female").model
    assert isinstance(model, PlusModel)
    return model


def walks(frames: int) -> Tensor:
    """(2, T, 69): from the walk's first frame, and from a later one."""
    theta = torch.from_numpy(dsnet.load_motion("sample:walking").theta)
    return torch.stack([theta[:frames], theta[40 : 40 + frames]])


def layer_of(plus: PlusModel, dtype: torch.dtype = torch.float64) -> SoftTissue:
    return SoftTissue(plus.trained, load_body_model("embedded:female"), dtype)


def predicted(plus: PlusModel, theta: Tensor, betas: Tensor) -> Tensor:
    """Offsets (B, T, V, 3) that `predict` writes."""
    people = zip(theta.numpy(), betas.numpy(), strict=True)
    each = [np.concatenate([*predict_whole(plus, *one).offsets_m]) for one in people]
    return torch.from_numpy(np.stack(each))


@pytest.mark.parametrize("frames", [1, 2, 3, 90])
def test_values_are_those_of_predict(plus: PlusModel, frames: int) -> None:
    theta = walks(frames)
    with torch.no_grad():
        offsets_m, state = layer_of(plus, torch.float32)(theta.float(), PEOPLE)
    expected = predicted(plus, theta, PEOPLE)
    assert offsets_m.shape == expected.shape
    assert (offsets_m - expected).abs().max() < 1e-6
    assert state.frames == state.given == frames
    if frames > 2:
        assert expected.abs().max() > 3e-3


@torch.no_grad()
@pytest.mark.parametrize("look_ahead", [0, 3])
def test_a_model_may_look_further_ahead_or_not_at_all(plus: PlusModel, look_ahead: int) -> None:
    body = load_body_model("embedded:female")
    other = PlusModel(replace(plus.trained, look_ahead=look_ahead), body)
    layer, theta = layer_of(other), walks(40)
    whole, _ = layer(theta, PEOPLE.double())
    assert (whole - predicted(other, theta, PEOPLE)).abs().max() < 1e-6
    first, state = layer(theta[:, :17], PEOPLE.double(), more=True)
    second, _ = layer(theta[:, 17:], PEOPLE.double(), state)
    assert first.shape[1] == 17 - look_ahead
    assert (torch.cat([first, second], 1) - whole).abs().max() < 1e-12


@torch.no_grad()
@pytest.mark.parametrize("ends", [(1, 2, 3, 30), (20,), (1,)])
def test_pieces_are_the_whole(plus: PlusModel, ends: tuple[int, ...]) -> None:
    layer, theta, betas = layer_of(plus), walks(40), PEOPLE.double()
    whole, _ = layer.at_nodes(theta, betas)
    parts, state = [], None
    for start, end in zip((0, *ends), (*ends, 40), strict=True):
        part, state = layer.at_nodes(theta[:, start:end], betas, state, more=end < 40)
        parts.append(part)
    assert (torch.cat(parts, 1) - whole).abs().max() < 1e-12


@torch.no_grad()
def test_a_motion_that_was_thought_to_end_goes_on(plus: PlusModel) -> None:
    layer, theta, betas = layer_of(plus), walks(40), PEOPLE.double()
    whole, _ = layer.at_nodes(theta, betas)
    first, state = layer.at_nodes(theta[:, :25], betas)
    second, _ = layer.at_nodes(theta[:, 25:], betas, state)
    assert (first.shape[1], second.shape[1]) == (25, 15)
    known = 25 - layer.look_ahead
    assert (first[:, :known] - whole[:, :known]).abs().max() < 1e-12
    assert (second - whole[:, 25:]).abs().max() < 1e-12
    # The last frames of a motion that ends are as if the body stopped there.
    assert (first[:, known:] - whole[:, known:25]).abs().max() > 1e-6


def test_gradients_are_those_of_finite_differences(
    plus: PlusModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By pose, place, shape and all parameters, with and without pieces that are recomputed."""
    layer, theta, betas = layer_of(plus), walks(10).clone(), PEOPLE.double()
    drawn = torch.Generator().manual_seed(0)
    probe = torch.randn((2, 10, 3, 500), generator=drawn, dtype=torch.float64)

    def loss() -> Tensor:
        return (layer.at_nodes(theta, betas)[0] * probe).sum()

    variables = {"theta": theta, "betas": betas, **dict(layer.named_parameters())}
    theta.requires_grad_()
    betas.requires_grad_()
    gradients = torch.autograd.grad(loss(), [*variables.values()])
    monkeypatch.setattr(soft_tissue, "PIECE", 3)
    again = torch.autograd.grad(loss(), [*variables.values()])
    for (name, variable), gradient, same in zip(variables.items(), gradients, again, strict=True):
        torch.testing.assert_close(gradient, same, rtol=1e-9, atol=1e-12)
        towards = torch.randn(variable.shape, generator=drawn, dtype=torch.float64)
        losses, here = [], variable.detach().clone()
        with torch.no_grad():
            for step in (1e-6, -1e-6):
                variable.copy_(here + step * towards)
                losses.append(loss().item())
            variable.copy_(here)
        slope = (losses[0] - losses[1]) / 2e-6
        assert slope == pytest.approx(float((gradient * towards).sum()), rel=1e-5), name


def test_a_gradient_computes_each_piece_once_more(
    plus: PlusModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed, simulate = [], soft_tissue.simulate
    monkeypatch.setattr(soft_tissue, "PIECE", 5)
    monkeypatch.setattr(
        soft_tissue,
        "simulate",
        lambda *given: computed.append(given[1].shape[1]) or simulate(*given),
    )
    theta = walks(20).requires_grad_()
    loss = layer_of(plus).at_nodes(theta, PEOPLE.double())[0].square().sum()
    once = sum(computed)
    loss.backward()
    assert once == 19  # the first frame is at rest
    assert sum(computed) == 2 * once


def test_second_derivatives_are_refused(plus: PlusModel) -> None:
    theta = walks(4).requires_grad_()
    loss = layer_of(plus).at_nodes(theta, PEOPLE.double())[0].square().sum()
    with pytest.raises(NotImplementedError, match="second derivatives"):
        torch.autograd.grad(loss, theta, create_graph=True)


def test_smplx_moves_with_soft_tissue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The five lines beside smplx, on a body in another order than the model's own."""
    smplx = pytest.importorskip("smplx")
    body, path = _downloaded(tmp_path)
    theta, betas = walks(30).float(), PEOPLE
    flat, shapes = theta.flatten(0, 1), betas.repeat_interleave(30, 0)
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # of NumPy's, about how it makes tensors
        smpl = smplx.create(str(path), "smpl", gender="female", ext="pkl")
        dsnet.soft_tissue()
        assert "in another order than SMPL's" in capsys.readouterr().err
        layer = dsnet.soft_tissue(body=path)
        assert "another order" not in capsys.readouterr().err
        offsets_m, _ = layer(theta, betas)
        hands = flat.new_zeros(60, 6)
        posed = smpl(shapes, torch.cat([flat[:, 3:66], hands], 1), flat[:, :3], flat[:, 66:])
        moving = posed.vertices.unflatten(0, (2, 30)) + layer.in_world(offsets_m, theta)
        ours = SMPL(body)(shapes, flat[:, :66].unflatten(1, (22, 3)), flat[:, 66:],
                          offsets_m.flatten(0, 1))  # fmt: skip
    torch.testing.assert_close(layer.v_template, smpl.v_template)
    assert (moving.flatten(0, 1) - ours).abs().max() < 5e-6
    assert offsets_m.abs().max() > 3e-3
    model = load_model("female", body=path).model
    assert isinstance(model, PlusModel)
    assert (offsets_m - predicted(model, walks(30), betas)).abs().max() < 1e-6


def _downloaded(folder: Path) -> tuple[BodyModelData, Path]:
    """A file like SMPL's, whose vertices have other numbers than the embedded body's."""
    home = load_body_model("embedded:female")
    body = replace(renumbered(with_pelvis_off(home))[0], source="licensed")
    path = folder / "SMPL_FEMALE.pkl"
    body.save_smpl_pkl(path)
    path.write_bytes(pickle.dumps(pickle.loads(path.read_bytes()), 2))
    return body, path


@pytest.mark.parametrize(
    ("theta", "betas"), [((2, 5, 72), (2, 10)), ((5, 69), (1, 10)), ((2, 5, 69), (1, 10))]
)
def test_shapes_that_do_not_fit_are_refused(
    plus: PlusModel, theta: tuple[int, ...], betas: tuple[int, ...]
) -> None:
    with pytest.raises(DsnetError, match="69"):
        layer_of(plus)(torch.zeros(theta), torch.zeros(betas))
