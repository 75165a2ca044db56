"""Latents by Keras in place of ONNX Runtime: the same body, and what is written says which."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bridge import DsnetError
from bridge.runs import read_artifact
from dsnet.prediction.load_model import load_model
from dsnet.prediction.prediction_files import KIND, predict_motion
from tests.forged.amass import save, smplh


def test_keras_predicts_what_onnx_runtime_does(trained_run, tmp_path):
    poses = np.random.default_rng(1).normal(0, 0.2, (51, 156))
    motion = save(tmp_path / "a_poses.npz", smplh(51, 100.0) | {"source": "synthetic"}, poses=poses)
    write = "offsets", "latents"
    by_onnx = predict_motion(trained_run, motion, tmp_path / "onnx", write=write)
    # In a process of its own, as no framework may be loaded here.
    code = "import sys; from dsnet.cli import main; main(sys.argv[1:])"
    options = ["--run", "r", "--predictor", "dsnet_standardised", "--runtime", "keras"]
    options += ["--motion", str(motion), "--out", str(tmp_path / "keras"), "--write", *write]
    done = subprocess.run(
        [sys.executable, "-c", code, "predict", *options],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    by_keras = read_artifact(tmp_path / "keras", KIND)
    for made, runtime, name in ((by_onnx, "onnx", "ONNX"), (by_keras, "keras", "Keras")):
        assert made.manifest["runtime"] == runtime
        assert (f"predicts with {name}" in done.stderr) == (made is by_keras)
    for name, tolerance in (("latents", 2e-5), ("offsets", 1e-6)):
        expected = by_onnx.array(name)
        assert np.ptp(expected, axis=0).max() > 1000 * tolerance
        np.testing.assert_allclose(by_keras.array(name), expected, rtol=1e-5, atol=tolerance)


def test_what_keras_has_not_trained_is_refused(plus_run):
    with pytest.raises(DsnetError, match="--runtime keras with dsnet_plus"):
        load_model(plus_run, runtime="keras")
