"""The network's sizes, its arithmetic, and its weights as arrays."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange import load_weights, save_weights
from bridge.verify.reference import dsnet as reference
from tf_dsnet.framework import keras
from tf_dsnet.model import assign_weights, build_dsnet, named_weights, parameter_counts

SHAPES = {
    "fc_enc_1/kernel": (79, 64),
    "fc_enc_1/bias": (64,),
    "fc_enc_2/kernel": (64, 128),
    "fc_enc_2/bias": (128,),
    "lstm/kernel": (128, 240),
    "lstm/recurrent_kernel": (60, 240),
    "lstm/bias": (240,),
    "batch_norm/gamma": (60,),
    "batch_norm/beta": (60,),
    "batch_norm/moving_mean": (60,),
    "batch_norm/moving_variance": (60,),
    "fc_enc_3/kernel": (60, 100),
    "fc_enc_3/bias": (100,),
}


@pytest.mark.parametrize("masked", [False, True])
def test_parameter_counts_are_the_papers(masked):
    model = build_dsnet(masked=masked)
    assert parameter_counts(model) == {"dsnet": 65_140, "dsnet_trainable": 65_020}
    assert {name: array.shape for name, array in named_weights(model).items()} == SHAPES


def test_activations_are_those_of_section_5():
    model = build_dsnet()
    assert model.get_layer("fc_enc_1").activation is keras.activations.linear
    assert model.get_layer("fc_enc_2").activation is keras.activations.tanh
    assert model.get_layer("fc_enc_3").activation is keras.activations.linear


def test_network_computes_what_the_float64_reference_does(weights):
    model = build_dsnet()
    assign_weights(model, weights)
    motion = np.random.default_rng(0).normal(size=(2, 50, 79)).astype(np.float32)
    wide = {name: array.astype(np.float64) for name, array in weights.items()}
    expected = reference.predict(wide, motion.astype(np.float64))["fc_enc_3"]
    np.testing.assert_allclose(model(motion, training=False), expected, rtol=1e-5, atol=2e-5)


def test_weights_survive_a_file_bit_for_bit(weights, tmp_path):
    model = build_dsnet()
    save_weights(tmp_path / "w.safetensors", weights)
    assign_weights(model, load_weights(tmp_path / "w.safetensors"))
    for name, array in named_weights(model).items():
        np.testing.assert_array_equal(array, weights[name])


def test_foreign_weights_are_refused(weights):
    wrong = {**weights, "lstm/bias": np.zeros(120, np.float32)}
    with pytest.raises(DsnetError, match="lstm/bias"):
        assign_weights(build_dsnet(), wrong)
    del wrong["lstm/bias"]
    with pytest.raises(DsnetError, match="lstm/bias"):
        assign_weights(build_dsnet(), wrong)


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_network_loads_no_torch_whatever_keras_is_told_and_says_nothing():
    done = run_python(
        "import os, sys; os.environ['KERAS_BACKEND'] = 'torch'\n"
        "import tf_dsnet, tf_dsnet.stage_train, tf_dsnet.stage_infer, numpy\n"
        "tf_dsnet.build_dsnet()(numpy.zeros((1, 2, 79), 'f4'))\n"
        "sys.exit('torch' in sys.modules)"
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_streaming_loads_no_framework():
    done = run_python(
        "import sys; from tf_dsnet import StreamingBodies, StreamingPredictor\n"
        "sys.exit(bool({'torch', 'tensorflow', 'keras'} & set(sys.modules)))"
    )
    assert done.returncode == 0, done.stderr
