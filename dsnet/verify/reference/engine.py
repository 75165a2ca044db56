"""The reference as an engine: every operation in float64."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bridge.body import load_body_model
from bridge.exchange.engine import Tensors, serve
from bridge.motion import unpack_theta
from dsnet.verify.reference import descent, dsnet, mesh_autoencoder, oscillators, smpl


def dsnet_graph(
    w: Tensors, theta: np.ndarray, betas: np.ndarray, body: str, architecture: Mapping[str, Any]
) -> Tensors:
    """Posed skin of B characters with poses theta (T, B, 69), by DSNet and the decoder."""
    del architecture
    data = load_body_model(body)
    inputs = np.concatenate([np.broadcast_to(betas, (*theta.shape[:2], 10)), theta], axis=-1)
    latents = dsnet.predict_latents(w, inputs.swapaxes(0, 1)).swapaxes(0, 1)
    frames = []
    for pose, codes in zip(theta, latents, strict=True):
        offsets_m = mesh_autoencoder.decode(w, codes)
        frames.append(smpl.posed_vertices(data, betas, *unpack_theta(pose), offsets_m))
    return {"layer/vertices": np.stack(frames)}


OPERATIONS = (
    dsnet.dsnet_forward,
    dsnet.dsnet_stream,
    dsnet.dsnet_train,
    dsnet.dsnet_fit,
    dsnet.dsnet_exported,
    mesh_autoencoder.ae_forward,
    mesh_autoencoder.ae_decode,
    mesh_autoencoder.ae_train,
    smpl.smpl,
    descent.descent,
    oscillators.oscillators_train,
    dsnet_graph,
    oscillators.plus_graph,
    oscillators.soft_tissue,
    oscillators.soft_tissue_slopes,
)

if __name__ == "__main__":
    serve(*OPERATIONS, packages=("scipy",))
