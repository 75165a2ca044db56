"""The networks: parameter counts, the matrix form against Conv1d, shapes, initialisation."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.speed.autoencoder import conv1d_forward
from bridge import DsnetError
from torch_align_ae import CasasOtaduyAutoencoder, MeshAutoencoder
from torch_align_ae.autoencoder.mesh_autoencoder import (
    initialise_with_modes,
    parameter_count,
)
from torch_align_ae.autoencoder.stage_train_ae import parameter_counts

SMALL = (60, 40, 30, 20, 12)


def test_parameter_counts_are_the_papers():
    assert parameter_counts() == {
        "mesh_autoencoder": 33_626_606,
        "mesh_autoencoder_alternative": 33_626_606,
        "casas_otaduy": 284_678_770,
    }


def test_one_matrix_product_a_layer_equals_conv1d():
    torch.manual_seed(0)
    model = MeshAutoencoder(SMALL).double()
    offsets = torch.randn(5, 60, 3, dtype=torch.float64)
    fast = torch.autograd.grad(model(offsets).square().sum(), list(model.parameters()))
    plain = conv1d_forward(model, offsets)
    slow = torch.autograd.grad(plain.square().sum(), list(model.parameters()))
    np.testing.assert_allclose(model(offsets).detach(), plain.detach(), atol=1e-14)
    for found, expected in zip(fast, slow, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14)


def test_the_paper_sized_network_encodes_and_decodes_each_frame_alone():
    torch.manual_seed(0)
    model, offsets = MeshAutoencoder(), torch.randn(3, 6890, 3)
    with torch.inference_mode():
        latents = model.encode(offsets)
        rebuilt = model.decode(latents)
        alone = model.encode(offsets[1:2])
    assert latents.shape == (3, 100)
    assert rebuilt.shape == (3, 6890, 3)
    np.testing.assert_allclose(alone, latents[1:2], atol=1e-5)


@pytest.mark.parametrize("size", [25, 50])
def test_a_smaller_code_costs_its_own_weights_only(size):
    with torch.device("meta"):
        mesh, mesh_less = MeshAutoencoder(), MeshAutoencoder(latent_size=size)
        theirs, theirs_less = CasasOtaduyAutoencoder(), CasasOtaduyAutoencoder(latent_size=size)
    less = 100 - size
    assert parameter_count(theirs) == parameter_counts()["casas_otaduy"]
    assert parameter_count(theirs) - parameter_count(theirs_less) == less * (2 * 3000 + 1)
    assert parameter_count(mesh) - parameter_count(mesh_less) == less * (2 * 30 * 9 + 1)


def test_a_foreign_topology_is_one_line():
    with pytest.raises(DsnetError, match=r"\(2, 61, 3\).*60"):
        MeshAutoencoder(SMALL).encode(torch.zeros(2, 61, 3))


@pytest.fixture
def sample():
    """(50, 60, 3) values whose first vertices move most."""
    generator = torch.Generator().manual_seed(1)
    return torch.randn(50, 60, 3, generator=generator) * torch.linspace(3, 0.1, 60)[:, None]


def test_modes_begin_as_an_exactly_linear_code_of_the_leading_vertex_modes(sample):
    model = MeshAutoencoder(SMALL)
    initialise_with_modes(model, sample, seed=0)
    with torch.inference_mode():
        rebuilt, latents = model(sample), model.encode(sample)
        combined = model(2 * sample[:1] - 3 * sample[1:2])
    left, _, _ = np.linalg.svd(sample.transpose(0, 1).flatten(1).double().numpy())
    projector = left[:, :12] @ left[:, :12].T
    expected = np.einsum("uv,bvc->buc", projector, sample.numpy())
    np.testing.assert_allclose(rebuilt, expected, atol=2e-4)
    np.testing.assert_allclose(combined, 2 * rebuilt[:1] - 3 * rebuilt[1:2], atol=1e-3)
    np.testing.assert_allclose(latents.square().mean().sqrt(), 1, rtol=1e-5)


def test_fewer_latents_begin_with_what_of_the_vertex_modes_has_most_energy(sample):
    model = MeshAutoencoder(SMALL, latent_size=6)
    initialise_with_modes(model, sample, seed=0)
    left, _, _ = np.linalg.svd(sample.transpose(0, 1).flatten(1).double().numpy())
    modes = np.einsum("vm,bvc->bmc", left[:, :12], sample.numpy())
    right = np.linalg.svd(modes.reshape(50, -1))[2][:6]
    kept = (modes.reshape(50, -1) @ right.T @ right).reshape(modes.shape)
    expected = np.einsum("vm,bmc->bvc", left[:, :12], kept)
    with torch.inference_mode():
        np.testing.assert_allclose(model(sample), expected, atol=2e-4)


@pytest.mark.parametrize("size", [10, 100])
def test_modes_leave_no_weight_without_a_gradient_and_no_feature_a_copy(size):
    torch.manual_seed(0)
    sample = torch.randn(64, 60, 3)
    model = MeshAutoencoder(SMALL, latent_size=size)
    initialise_with_modes(model, sample, seed=0)
    adam = torch.optim.Adam(model.parameters(), 1e-3)
    for _ in range(3):
        adam.zero_grad()
        (model(sample) - sample).square().mean().backward()
        adam.step()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None
        assert (parameter.grad != 0).all(), name
    weight = model.get_parameter("decoder.linear_1.weight")
    assert len(weight.unique(dim=1).T) == weight.shape[1]
