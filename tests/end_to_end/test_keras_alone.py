"""Who has Keras alone goes from a motion to vertices, and arrives where both frameworks do."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from bridge.body import load_body_model, pose_vertices
from bridge.motion import sequences_of, subject_rows, unpack_theta
from bridge.runs import Run, read_artifact
from bridge.runs.run import body_model_path
from tests.pages import python_blocks

ALONE = """
import sys, numpy
from bridge.body import load_body_model
from bridge.motion import unpack_theta
from bridge.runs import Run
from bridge.runs.run import body_model_path
from bridge.exchange import load_weights
from tf_dsnet import KerasMeshAutoencoder, KerasSMPL
from tf_dsnet.mesh_autoencoder import assign_weights
from tf_dsnet.predictors import load_predictor

run, (motion, out) = Run("smoke"), sys.argv[1:]
given = numpy.load(motion)
train = run.artifact("train")
body = load_body_model(str(body_model_path(run)))
predict = load_predictor(train, train.manifest["default"], lambda: body)
latents = predict(given["theta"], given["betas"])
trained = run.artifact("train-ae")
weights = load_weights(trained.file("autoencoder.safetensors"))
mean_m, scale_m = (weights.pop(f"normaliser.{name}") for name in ("mean_m", "scale_m"))
network = KerasMeshAutoencoder(trained.manifest["architecture"]["widths"])
assign_weights(network.model, {n.removeprefix("model."): array for n, array in weights.items()})
offsets = network.decoder(latents) * scale_m + mean_m
pose, trans = unpack_theta(given["theta"])
smpl = KerasSMPL(body)
vertices = smpl(numpy.tile(given["betas"], (len(pose), 1)), pose, trans, offsets)
numpy.savez(out, latents=latents, offsets=offsets, vertices=vertices)
sys.exit("torch" in sys.modules)
"""


@pytest.mark.slow
def test_a_motion_becomes_vertices_without_pytorch(smoke_runs, execute, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(smoke_runs))
    predicted, decoded = (read_artifact(smoke_runs / "smoke" / s) for s in ("infer", "decode"))
    name, there = predicted.manifest["default"], sequences_of(decoded)[-1]
    here = next(s for s in sequences_of(predicted) if s.name == there.name)
    theta = predicted.array("theta")[here.frames]
    betas = predicted.array("betas")[subject_rows(sequences_of(predicted))[here.subject]]
    np.savez(tmp_path / "motion.npz", theta=theta, betas=betas)

    files = [str(tmp_path / name) for name in ("motion.npz", "alone.npz")]
    done = execute([sys.executable, "-c", ALONE, *files], smoke_runs)
    assert done.returncode == 0, done.stderr
    alone = np.load(files[1])
    expected = predicted.array(f"latents_{name}")[here.frames]
    np.testing.assert_allclose(alone["latents"], expected, atol=1e-5 * np.abs(expected).max())
    offsets_m = decoded.array(f"offsets_{name}")[there.frames]
    np.testing.assert_allclose(alone["offsets"], offsets_m, atol=1e-6)
    body = load_body_model(str(body_model_path(Run("smoke"))))
    posed = pose_vertices(body, np.tile(betas, (len(theta), 1)), *unpack_theta(theta), offsets_m)
    np.testing.assert_allclose(alone["vertices"], posed, atol=1e-5)


@pytest.mark.slow
def test_a_runs_network_opens_as_the_page_says(smoke_runs, execute, tmp_path):
    """What it gives there: `tests/tf_dsnet/test_keras_files.py`, and `dsnet verify` of a run."""
    for to, out in {
        "keras": "dsnet.keras",
        "savedmodel": "served",
        "tflite": "step.tflite",
    }.items():
        asked = ["--run", "smoke", "--predictor", "dsnet_faithful", "--to", to]
        command = [".venv/bin/dsnet", "export", *asked, "--out", str(tmp_path / out)]
        done = execute(command, smoke_runs)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / out).exists()
    (block,) = [one for one in python_blocks("docs/deployment.md") if "load_model" in one]
    code = f"import os\nos.chdir({str(tmp_path)!r})\n{block}\nassert latents.shape == (1, 240, 100)"
    done = execute([sys.executable, "-I", "-c", code], smoke_runs)
    assert done.returncode == 0, done.stderr
