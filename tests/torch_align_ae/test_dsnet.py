"""DSNet's PyTorch twin against the float64 reference, and where it must not be PyTorch's way."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange.weights import KERAS_ADAM, dsnet_from_torch
from dsnet.verify import draws
from dsnet.verify.reference import dsnet as reference
from torch_align_ae.dsnet import DSNet, KerasAdam, assign_weights, sum_of_distances


@pytest.fixture
def weights() -> dict[str, NDArray]:
    return {name: array.astype(np.float64) for name, array in draws.dsnet_weights(3).items()}


@pytest.fixture
def network(weights) -> DSNet:
    model = DSNet().double()
    assign_weights(model, weights)
    return model


@pytest.fixture
def batch() -> dict[str, NDArray]:
    """Three motions of different lengths, padded with zeros: motion, latents, real."""
    drawn = draws.clips(4, count=3, frames=9)
    return {n: a if n == "real" else a.astype(np.float64) for n, a in drawn.items()}


def tensors(batch: dict[str, NDArray]) -> tuple[Tensor, ...]:
    return tuple(map(torch.from_numpy, batch.values()))


def named_weights(model: DSNet) -> dict[str, NDArray]:
    """Copies of all weights in Keras's names and layout."""
    return dsnet_from_torch({name: v.detach().numpy() for name, v in model.state_dict().items()})


def test_counts_are_the_papers_and_kerass():
    """As Keras counts them: all, and those that training changes by gradients."""
    model = DSNet()
    trainable = sum(p.numel() for p in model.parameters() if p.requires_grad)
    assert (trainable, trainable + sum(b.numel() for b in model.buffers())) == (65_020, 65_140)


@torch.inference_mode()
def test_whole_clips_are_the_references_and_steps_are_whole_clips(network, weights, batch):
    motion = torch.from_numpy(batch["motion"])
    whole, state, parts = network.eval()(motion), None, []
    expected = reference.predict(weights, batch["motion"])["fc_enc_3"]
    np.testing.assert_allclose(whole, expected, atol=1e-12)
    for part in motion.split([1, 1, 3, 4], dim=1):
        latents, state = network.step(part, state)
        parts.append(latents)
    np.testing.assert_allclose(torch.cat(parts, 1), whole, atol=1e-13)


@pytest.mark.parametrize("masked", [False, True])
def test_ten_steps_of_training_are_the_references(network, weights, batch, masked):
    motion, latents, real = tensors(batch)
    seen = batch if masked else {**batch, "real": None}
    adam = KerasAdam(network.parameters())
    first = second = {name: np.zeros_like(array) for name, array in weights.items()}
    for t in range(1, 11):
        expected = reference.learn(weights, **seen)
        stepped, first, second = reference.adam_step(
            KERAS_ADAM, t, weights, expected.gradients, first, second
        )
        weights = {**weights, **expected.statistics, **stepped}

        adam.zero_grad()
        mask = real if masked else None
        loss = sum_of_distances(latents, network.train()(motion, mask), mask)
        loss.backward()
        adam.step()
        assert loss.item() == pytest.approx(expected.loss, rel=1e-12)
    for name, array in named_weights(network).items():
        # Where a gradient is almost 0 Adam divides rounding by rounding, up to a share of a step.
        np.testing.assert_allclose(array, weights[name], atol=1e-10, err_msg=name)


def test_the_epsilon_is_kerass(batch):
    """With tiny gradients the epsilon decides: PyTorch's place for it gives another step."""
    parameter = torch.nn.Parameter(torch.zeros(1, dtype=torch.float64))
    adam = KerasAdam([parameter])
    parameter.grad = torch.full_like(parameter, 1e-7)
    adam.step()
    kerass = -1e-4 * np.sqrt(1e-3) / 0.1 * 1e-8 / (np.sqrt(1e-17) + 1e-7)
    assert parameter.item() == pytest.approx(kerass, rel=1e-9)


@pytest.mark.parametrize("masked", [False, True])
def test_a_perfect_prediction_has_a_finite_gradient(masked):
    latents = torch.randn(2, 3, 100)
    predicted = latents.clone().requires_grad_()
    real = torch.tensor([[True, True, False]] * 2) if masked else None
    loss = sum_of_distances(latents, predicted, real)
    (gradient,) = torch.autograd.grad(loss, predicted)
    assert not gradient.any()


def test_fresh_weights_are_drawn_like_kerass():
    torch.manual_seed(0)
    w = named_weights(DSNet())
    limit = np.sqrt(6 / (79 + 64))
    assert np.abs(w["fc_enc_1/kernel"]).max() == pytest.approx(limit, rel=0.01)
    assert w["fc_enc_1/kernel"].std() == pytest.approx(limit / np.sqrt(3), rel=0.02)
    recurrent = w["lstm/recurrent_kernel"]
    np.testing.assert_allclose(recurrent @ recurrent.T, np.eye(60), atol=1e-5)
    np.testing.assert_array_equal(w["lstm/bias"], np.repeat([0, 1, 0, 0], 60))
    assert not any(w[f"fc_enc_{k}/bias"].any() for k in (1, 2, 3))


def test_weights_survive_either_file_bit_for_bit(network, tmp_path):
    weights = named_weights(network.float())
    save_weights(tmp_path / "w.safetensors", weights)
    torch.save(network.state_dict(), tmp_path / "w.pt")
    one, other = DSNet(), DSNet()
    assign_weights(one, load_weights(tmp_path / "w.safetensors"))
    other.load_state_dict(torch.load(tmp_path / "w.pt", weights_only=True))
    for model in (one, other):
        for name, array in named_weights(model).items():
            np.testing.assert_array_equal(array, weights[name])


def test_what_is_not_dsnets_is_one_line(network, weights):
    with pytest.raises(DsnetError, match=r"\(1, 2, 69\)"):
        network(torch.zeros(1, 2, 69))
    with pytest.raises(DsnetError, match="fc_enc_1/bias"):
        assign_weights(network, {**weights, "fc_enc_1/bias": np.zeros(1)})
