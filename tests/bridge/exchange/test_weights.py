"""Weights: files, checkpoints and layouts; round trips give every bit back."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.exchange import weights as layouts
from bridge.exchange.weights import load_checkpoint, save_checkpoint


def test_round_trip_is_bit_exact_even_for_views(tmp_path):
    weights: dict[str, NDArray] = {
        "a/kernel": np.arange(6, dtype=np.float32).reshape(2, 3).T,
        "b": np.array([np.pi]),
        "step": np.array(7),
    }
    save_weights(tmp_path / "w.safetensors", weights, kind="test")
    back = load_weights(tmp_path / "w.safetensors")
    assert set(back) == set(weights)
    for name, array in weights.items():
        assert (back[name].dtype, back[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(back[name], array)


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 zip", b"\xff" * 64])
def test_a_foreign_file_is_one_line(tmp_path, content):
    path = tmp_path / "w.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DsnetError, match="safetensors") as caught:
        load_weights(path)
    assert "\n" not in str(caught.value)


def _file(path, header, data=bytes(64)):
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + data)
    return path


@pytest.mark.parametrize(("kind", "size"), [("BF16", 8), ("F8_E4M3", 4), ("F4", 4), ("C64", 32)])
def test_types_that_are_no_numbers_of_numpys_are_one_line(tmp_path, kind, size):
    entry = {"dtype": kind, "shape": [4], "data_offsets": [0, size]}
    with pytest.raises(DsnetError, match="does not load"):
        load_weights(_file(tmp_path / "w.safetensors", {"a": entry}, bytes(size)))


def test_what_is_no_file_or_has_a_huge_header_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "huge").write_bytes((99 << 20).to_bytes(8, "little") + b" " * (99 << 20))
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path / "huge", tmp_path):
        with pytest.raises(DsnetError, match="does not load"):
            load_weights(path)


ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.zeros((0, 4), np.float32)}


def test_it_comes_back(tmp_path, capsys):
    save_checkpoint(tmp_path / "c", ARRAYS)
    found = load_checkpoint(tmp_path / "c")
    assert found is not None
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array, strict=True)
    assert load_checkpoint(tmp_path / "none") is None
    assert capsys.readouterr().err == ""


def test_every_changed_byte_makes_it_none_or_the_same(tmp_path, capsys):
    path = tmp_path / "c"
    save_checkpoint(path, ARRAYS)
    content = path.read_bytes()
    named = 0
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        found = load_checkpoint(path)
        if found is not None:
            for name, array in ARRAYS.items():
                np.testing.assert_array_equal(found[name], array, strict=True)
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == (found is None)
        named += found is None
    assert named > 0.9 * len(content)


@pytest.mark.parametrize("kept", [0, 7, 60, -1])
def test_a_cut_one_is_none(kept, tmp_path):
    path = tmp_path / "c"
    save_checkpoint(path, ARRAYS)
    path.write_bytes(path.read_bytes()[:kept])
    assert load_checkpoint(path) is None


def test_weights_without_a_digest_are_none(tmp_path):
    save_weights(tmp_path / "c", ARRAYS)
    assert load_checkpoint(tmp_path / "c") is None


DSNET_SHAPES = {
    "fc_enc_1/kernel": (5, 4),
    "fc_enc_1/bias": (4,),
    "fc_enc_2/kernel": (4, 4),
    "fc_enc_2/bias": (4,),
    "lstm/kernel": (4, 12),
    "lstm/recurrent_kernel": (3, 12),
    "lstm/bias": (12,),
    "batch_norm/gamma": (3,),
    "batch_norm/beta": (3,),
    "batch_norm/moving_mean": (3,),
    "batch_norm/moving_variance": (3,),
    "fc_enc_3/kernel": (3, 3),
    "fc_enc_3/bias": (3,),
}
MESH_SHAPES = {
    "encoder.linear_1.weight": (4, 3),
    "encoder.linear_1.bias": (4,),
    "encoder.conv_1.weight": (5, 7, 1),
    "encoder.conv_1.bias": (5,),
    "to_latent.weight": (6, 6),
    "to_latent.bias": (6,),
}


def any_bits(shapes: dict[str, tuple[int, ...]], seed: int, dtype: str) -> dict[str, NDArray]:
    """Arrays of random bits: NaNs, infinities, denormals and -0.0 among them."""
    rng = np.random.default_rng(seed)
    return {
        name: np.frombuffer(rng.bytes(int(np.prod(shape)) * int(dtype[-1])), dtype).reshape(shape)
        for name, shape in shapes.items()
    }


def assert_same_bits(one: dict[str, NDArray], other: dict[str, NDArray]) -> None:
    assert one.keys() == other.keys()
    for name, array in one.items():
        assert (other[name].shape, other[name].dtype) == (array.shape, array.dtype), name
        assert other[name].tobytes() == array.tobytes(), name


@given(st.integers(0, 2**32), st.sampled_from(["<f4", "<f8"]))
def test_dsnet_comes_back_bit_for_bit(seed, dtype):
    weights = any_bits(DSNET_SHAPES, seed, dtype)
    assert_same_bits(weights, layouts.dsnet_from_torch(layouts.dsnet_to_torch(weights)))


def test_negative_zeros_come_back():
    weights = {name: np.full(shape, -0.0) for name, shape in DSNET_SHAPES.items()}
    assert_same_bits(weights, layouts.dsnet_from_torch(layouts.dsnet_to_torch(weights)))


@given(st.integers(0, 2**32), st.sampled_from(["<f4", "<f8"]))
def test_the_autoencoder_comes_back_bit_for_bit(seed, dtype):
    weights = any_bits(MESH_SHAPES, seed, dtype)
    there = layouts.mesh_autoencoder_to_keras(weights)
    assert there["encoder.conv_1/kernel"].shape == (7, 5)
    assert_same_bits(weights, layouts.mesh_autoencoder_from_keras(there))


def test_square_kernels_are_transposed_too():
    weights = {name: np.random.default_rng(0).normal(size=s) for name, s in DSNET_SHAPES.items()}
    state = layouts.dsnet_to_torch(weights)
    np.testing.assert_array_equal(state["fc_enc_2.weight"], weights["fc_enc_2/kernel"].T)
    np.testing.assert_array_equal(state["lstm.weight_ih_l0"], weights["lstm/kernel"].T)
    np.testing.assert_array_equal(state["lstm.bias_hh_l0"], np.zeros(12))


def test_a_second_bias_is_added():
    weights = {name: np.ones(shape) for name, shape in DSNET_SHAPES.items()}
    state = layouts.dsnet_to_torch(weights)
    state["lstm.bias_hh_l0"] = np.arange(12.0)
    np.testing.assert_array_equal(
        layouts.dsnet_from_torch(state)["lstm/bias"], 1.0 + np.arange(12.0)
    )
    np.testing.assert_array_equal(weights["lstm/bias"], np.ones(12))


def test_a_part_is_converted_alone():
    gradients = {"fc_enc_1/kernel": np.ones((5, 4)), "lstm/kernel": np.ones((4, 12))}
    state = layouts.dsnet_to_torch(gradients)
    assert set(state) == {"fc_enc_1.weight", "lstm.weight_ih_l0"}
    assert_same_bits(gradients, layouts.dsnet_from_torch(state))


def test_foreign_names_are_one_line():
    with pytest.raises(DsnetError, match="surprise"):
        layouts.dsnet_to_torch({"surprise": np.zeros(1)})
    with pytest.raises(DsnetError, match=r"lstm\.bias_ih_l1"):
        layouts.dsnet_from_torch({"lstm.bias_ih_l1": np.zeros(1)})
    for convert in (layouts.mesh_autoencoder_to_keras, layouts.mesh_autoencoder_from_keras):
        with pytest.raises(DsnetError, match="scale"):
            convert({"encoder.linear_1.scale": np.zeros(1)})
