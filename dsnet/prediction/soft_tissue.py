"""The trained model as a layer of PyTorch."""

from __future__ import annotations

import os
from typing import Any

from bridge.errors import DsnetError, notify
from dsnet.prediction.load_model import Source, load_model
from dsnet.prediction.models import PlusModel
from dsnet.prediction.runtimes import torch_soft_tissue


def soft_tissue(
    model: Source = None,
    *,
    body: str | os.PathLike[str] | None = None,
    gender: str = "unknown",
) -> Any:
    """The `torch.nn.Module` that gives offsets of motions, with gradients, on any device.

        layer = dsnet.soft_tissue(body="SMPL_FEMALE.pkl")
        offsets_m, state = layer(theta, betas)      # (B, T, 69), (B, 10) -> (B, T, V, 3) metres
        moving_m = posed_m + layer.in_world(offsets_m, theta)

    `posed_m` are vertices as `smplx` or any other SMPL poses them; `torch_align_ae.SoftTissue` is
    the class. Values are those of `animate`.

    Parameters
    ----------
    model : as for `load_model`; one that has a `dsnet_plus`.
    body : an SMPL, SMPL-H or SMPL-X model file, in whose vertex order offsets are given; None: the
        body that the model was trained on; a line says so where that is an embedded one, whose
        order is not SMPL's.
    gender : of the packaged model, where neither `model` nor `body` says it.

    Raises
    ------
    DsnetError
        As for `load_model`; if the model is a paper's DSNet, or PyTorch is not installed.
    """
    trained = load_model(model, gender=gender, body=body)
    if not isinstance(trained.model, PlusModel):
        raise DsnetError(
            f"{trained.name} of {trained.owner} as a layer of soft tissue",
            "dsnet_plus",
            "Take the packaged model; the paper's network is torch_align_ae.dsnet.DSNet.",
        )
    if body is None and trained.body.source == "synthetic":
        notify(
            f"offsets of {trained.body.name}, in another order than SMPL's; body=FILE takes yours"
        )
    return torch_soft_tissue(trained.model.trained, trained.body)
