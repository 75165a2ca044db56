"""The networks' graphs, run by onnxruntime: every layer is the float64 reference's, and DSNet with
its decoder and body is the prediction of the clip, posed by the oracle."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.motion import unpack_theta
from bridge.runtime import network_graphs
from bridge.runtime.network_graphs import decoder_graph, dsnet_body_graph
from bridge.runtime.onnx_graph import GraphSession, held_arrays
from bridge.runtime.stepping import DsnetModel, predict_whole
from bridge.verify import draws
from bridge.verify.draws import SMALL_WIDTHS
from bridge.verify.reference import dsnet, mesh_autoencoder

ACTIVATIONS = ("leaky_relu", "elu", "tanh", "relu")
VERTICES = SMALL_WIDTHS[0]
VERTICES_LAST = ("encoder.", "decoder.", "to_coordinates")


def run(model: onnx.ModelProto, **inputs: NDArray) -> dict[str, NDArray]:
    return GraphSession(model)(**inputs)


def wide(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    return {name: array.astype(np.float64) for name, array in arrays.items()}


@pytest.fixture(scope="module")
def dsnet_weights() -> dict[str, NDArray]:
    return draws.dsnet_weights(0)


@pytest.fixture(scope="module")
def motion() -> NDArray:
    return draws.motion(1, clips=3, frames=12)["motion"]


def at_rest(batch: int) -> dict[str, NDArray]:
    return {name: np.zeros((1, batch, 60), np.float32) for name in ("hidden", "cell")}


def test_every_layer_of_dsnet_is_the_references(dsnet_weights, motion):
    expected = dsnet.predict(wide(dsnet_weights), motion.astype(np.float64))
    model = network_graphs.dsnet_graph(dsnet_weights, trace=True)
    found = run(model, motion=motion, **at_rest(3))
    for layer in dsnet.LAYERS:
        np.testing.assert_allclose(found[layer], expected[layer], atol=2e-5, err_msg=layer)
    np.testing.assert_array_equal(found["latents"], found["fc_enc_3"])
    np.testing.assert_array_equal(found["next_hidden"][0], found["lstm"][:, -1])


def test_frame_by_frame_is_the_whole_motion(dsnet_weights, motion):
    model = network_graphs.dsnet_graph(dsnet_weights)
    whole, state, frames = run(model, motion=motion, **at_rest(3)), at_rest(3), []
    assert set(whole) == {"latents", "next_hidden", "next_cell"}
    for frame in np.split(motion, motion.shape[1], axis=1):
        found = run(model, motion=frame, **state)
        state = {"hidden": found["next_hidden"], "cell": found["next_cell"]}
        frames.append(found["latents"])
    np.testing.assert_allclose(np.concatenate(frames, axis=1), whole["latents"], atol=1e-5)


def mesh_weights(activation: str) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Random weights in PyTorch's layout, and the architecture that they are of."""
    architecture = {"widths": SMALL_WIDTHS, "activation": activation, "negative_slope": 0.1}
    return draws.autoencoder_weights(2, SMALL_WIDTHS), architecture


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_every_layer_of_the_autoencoder_is_the_references(activation):
    weights, architecture = mesh_weights(activation)
    values = draws.values(3, 4, VERTICES)["values"]
    encoded = run(network_graphs.encoder_graph(weights, architecture, trace=True), offsets=values)
    decoder = network_graphs.decoder_graph(weights, architecture, trace=True)
    found = {**encoded, **run(decoder, latents=encoded["latents"])}
    expected = mesh_autoencoder.forward(wide(weights), values.astype(np.float64), architecture)
    for layer, array in expected.outputs.items():
        outputs = found[layer].swapaxes(1, 2) if layer.startswith(VERTICES_LAST) else found[layer]
        np.testing.assert_allclose(outputs, array, atol=5e-5, err_msg=layer)
    np.testing.assert_array_equal(found["offsets"], found["to_coordinates"].swapaxes(1, 2))


def test_with_the_normaliser_the_graphs_take_metres():
    weights, architecture = mesh_weights("leaky_relu")
    rng = np.random.default_rng(4)
    mean_m = rng.normal(0, 1e-3, (VERTICES, 3)).astype(np.float32)
    scale_m = rng.uniform(1e-3, 1e-2, (VERTICES, 3)).astype(np.float32)
    metric = {**weights, "normaliser.mean_m": mean_m, "normaliser.scale_m": scale_m}
    values = rng.normal(size=(4, VERTICES, 3)).astype(np.float32)

    def through(arrays, offsets):
        encoded = run(network_graphs.encoder_graph(arrays, architecture), offsets=offsets)
        assert set(encoded) == {"latents"}
        return run(network_graphs.decoder_graph(arrays, architecture), **encoded)["offsets"]

    found = through(metric, values * scale_m + mean_m)
    expected = through(weights, values) * scale_m + mean_m
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_weights_come_back_from_the_files_bit_for_bit(dsnet_weights, tmp_path):
    onnx.save_model(network_graphs.dsnet_graph(dsnet_weights), tmp_path / "dsnet.onnx")
    assert_same(dsnet_weights, network_graphs.dsnet_weights(held_arrays(tmp_path / "dsnet.onnx")))

    weights, architecture = mesh_weights("elu")
    held = {}
    for part, build in (("e", network_graphs.encoder_graph), ("d", network_graphs.decoder_graph)):
        onnx.save_model(build(weights, architecture), tmp_path / f"{part}.onnx")
        held |= held_arrays(tmp_path / f"{part}.onnx")
    assert_same(weights, network_graphs.mesh_autoencoder_weights(held))


def assert_same(expected: dict[str, NDArray], found: dict[str, NDArray]) -> None:
    assert set(expected) == set(found)
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name], array, err_msg=name)


@pytest.mark.parametrize("content", [None, b"", b"not a model"])
def test_a_foreign_file_is_one_line(tmp_path: Path, content: bytes | None):
    path = tmp_path / "a.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DsnetError, match=r"a\.onnx"):
        held_arrays(path)


BODY = load_body_model("embedded:female")
BETAS = np.random.default_rng(5).normal(size=(2, 10)).astype(np.float32)
THETA = np.random.default_rng(6).normal(0, 0.4, (6, 2, 69)).astype(np.float32)


def clip(model) -> np.ndarray:
    """(T, B, V, 3)."""
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    state, found = np.zeros((2, session.get_inputs()[2].shape[1]), np.float32), []
    for frame in THETA:
        vertices, state = session.run(None, {"theta": frame, "betas": BETAS, "state": state})
        found.append(vertices)
    return np.stack(found)


def expected(network, decoder, architecture) -> np.ndarray:
    predict = partial(
        predict_whole, DsnetModel(network, GraphSession(decoder_graph(decoder, architecture)))
    )
    clips = []
    for theta, betas in zip(THETA.swapaxes(0, 1), BETAS, strict=True):
        offsets_m = np.concatenate(list(predict(theta, betas).offsets_m))
        shapes = np.tile(betas, (len(theta), 1))
        clips.append(pose_vertices(BODY, shapes, *unpack_theta(theta), offsets_m))
    return np.stack(clips, axis=1)


@pytest.mark.parametrize("activation", ["leaky_relu", "tanh"])
def test_frame_by_frame_is_the_whole_clip(trained, mesh_decoder, activation):
    decoder, architecture = mesh_decoder
    architecture = {**architecture, "activation": activation}
    found = clip(dsnet_body_graph(trained, decoder, architecture, BODY))
    wanted = expected(trained, decoder, architecture)
    np.testing.assert_allclose(found, wanted, atol=1e-5)
    rest = pose_vertices(BODY, BETAS, *unpack_theta(THETA[-1]))
    assert np.abs(wanted[-1] - rest).max() > 1e-3


def test_fewer_bits_cost_little(trained, mesh_decoder):
    decoder, architecture = mesh_decoder
    exact = clip(dsnet_body_graph(trained, decoder, architecture, BODY))
    found = clip(dsnet_body_graph(trained, decoder, architecture, BODY, precision="int8"))
    error_mm = 1e3 * np.linalg.norm(found - exact, axis=-1)
    assert 0 < error_mm.mean() < 0.2


def test_a_decoder_of_another_body_is_refused(trained, mesh_decoder):
    decoder, architecture = mesh_decoder
    with pytest.raises(DsnetError, match="40 vertices"):
        dsnet_body_graph(trained, decoder, {**architecture, "widths": (40, 12, 8, 6, 4)}, BODY)
