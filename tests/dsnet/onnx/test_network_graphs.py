"""The networks' graphs, run by onnxruntime: the decoder is the float64 reference's, and DSNet with
its decoder and body is the prediction of the clip, posed by the oracle."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.motion import unpack_theta
from dsnet.onnx.network_graphs import decoder_graph, dsnet_body_graph
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.prediction.models import DsnetModel, predict_whole
from dsnet.verify import draws
from dsnet.verify.draws import SMALL_WIDTHS
from dsnet.verify.reference import mesh_autoencoder
from tests.forged.codec import write_codec

VERTICES = SMALL_WIDTHS[0]


def wide(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    return {name: array.astype(np.float64) for name, array in arrays.items()}


def test_the_decoder_is_the_references():
    weights, rng = draws.autoencoder_weights(2, SMALL_WIDTHS), np.random.default_rng(4)
    weights["normaliser.mean_m"] = rng.normal(0, 1e-3, (VERTICES, 3)).astype(np.float32)
    weights["normaliser.scale_m"] = rng.uniform(1e-3, 1e-2, (VERTICES, 3)).astype(np.float32)
    latents = np.random.default_rng(3).normal(size=(4, 100)).astype(np.float32)
    architecture = {"widths": SMALL_WIDTHS}
    found = GraphSession(decoder_graph(weights, architecture))(latents=latents)["offsets"]
    expected = mesh_autoencoder.decode(wide(weights), latents.astype(np.float64))
    np.testing.assert_allclose(found, expected, atol=1e-6)


BODY = load_body_model("embedded:female")
BETAS = np.random.default_rng(5).normal(size=(2, 10)).astype(np.float32)
THETA = np.random.default_rng(6).normal(0, 0.4, (6, 2, 69)).astype(np.float32)


def expected(model: DsnetModel) -> np.ndarray:
    predict = partial(predict_whole, model)
    clips = []
    for theta, betas in zip(THETA.swapaxes(0, 1), BETAS, strict=True):
        offsets_m = np.concatenate(list(predict(theta, betas).offsets_m))
        shapes = np.tile(betas, (len(theta), 1))
        clips.append(pose_vertices(BODY, shapes, *unpack_theta(theta), offsets_m))
    return np.stack(clips, axis=1)


def test_frame_by_frame_is_the_whole_clip(trained, mesh_decoder, tmp_path):
    decoder, architecture = mesh_decoder
    model = DsnetModel(trained, write_codec(tmp_path / "train-ae", decoder, architecture), BODY)
    found, wanted = GraphSession(model.graph({}, "float32")).rollout(THETA, BETAS), expected(model)
    np.testing.assert_allclose(found, wanted, atol=1e-5)
    rest = pose_vertices(BODY, BETAS, *unpack_theta(THETA[-1]))
    assert np.abs(wanted[-1] - rest).max() > 1e-3


def test_a_decoder_of_another_body_is_refused(trained, mesh_decoder):
    decoder, architecture = mesh_decoder
    with pytest.raises(DsnetError, match="40 vertices"):
        dsnet_body_graph(trained, decoder, {**architecture, "widths": (40, 12, 8, 6, 4)}, BODY)
