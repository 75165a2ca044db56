"""Casas and Otaduy's autoencoder: its sizes."""

from __future__ import annotations

import torch

import torch_align_ae
from torch_align_ae import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.mesh_autoencoder import parameter_count
from torch_align_ae.autoencoder.stage_train_ae import parameter_counts


def test_it_has_the_papers_number_of_parameters():
    with torch.device("meta"):
        whole, half = CasasOtaduyAutoencoder(), CasasOtaduyAutoencoder(latent_size=50)
    assert parameter_count(whole) == parameter_counts()["casas_otaduy"] == 284_678_770
    assert parameter_count(whole) - parameter_count(half) == 50 * (2 * 3000 + 1)


def test_the_package_offers_it_with_what_else_it_promises():
    promised = {"SMPL", "CasasOtaduyAutoencoder", "MeshAutoencoder", "load_body_model", "unpose"}
    assert promised <= set(torch_align_ae.__all__)
    assert all(getattr(torch_align_ae, name) for name in promised)
    body = torch_align_ae.load_body_model("embedded:female")
    assert callable(body.save_smpl_npz)
    assert callable(body.save_smpl_pkl)


def test_it_keeps_shapes():
    model = CasasOtaduyAutoencoder((180, 40, 20), latent_size=10)
    latents = model.encode(torch.ones(2, 60, 3))
    assert latents.shape == (2, 10)
    assert model.decode(latents).shape == (2, 60, 3)
