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


OPENED = """
import sys, numpy, keras
given = numpy.load(sys.argv[2])
network = keras.models.load_model(sys.argv[1])
betas = numpy.tile(given["betas"], (len(given["theta"]), 1))
inputs = numpy.concatenate([betas, given["theta"]], 1)
numpy.save(sys.argv[3], network.predict(inputs[None], verbose=0)[0])
sys.exit(bool({"bridge", "dsnet", "tf_dsnet"} & {name.partition(".")[0] for name in sys.modules}))
"""


@pytest.mark.slow
def test_a_runs_networks_open_in_keras_alone(smoke_runs, execute, tmp_path):
    infer = read_artifact(smoke_runs / "smoke" / "infer")
    sequence = sequences_of(infer)[-1]
    betas = infer.array("betas")[subject_rows(sequences_of(infer))[sequence.subject]]
    np.savez(tmp_path / "motion.npz", theta=infer.array("theta")[sequence.frames], betas=betas)
    for name in ("dsnet_standardised", "dsnet_faithful"):
        out = tmp_path / f"{name}.keras"
        export = ["export", "--run", "smoke", "--predictor", name, "--to", "keras"]
        done = execute([".venv/bin/dsnet", *export, "--out", str(out)], smoke_runs)
        assert done.returncode == 0, done.stderr
        files = [str(out), str(tmp_path / "motion.npz"), str(tmp_path / "latents.npy")]
        done = execute([sys.executable, "-I", "-c", OPENED, *files], smoke_runs)
        assert done.returncode == 0, done.stderr
        expected = infer.array(f"latents_{name}")[sequence.frames]
        atol = 1e-6 * np.abs(expected).max()
        np.testing.assert_allclose(np.load(files[2]), expected, atol=atol)
    (tmp_path / "dsnet_faithful.keras").rename(tmp_path / "dsnet.keras")
    (block,) = [one for one in python_blocks("docs/deployment.md") if "load_model" in one]
    code = f"import os\nos.chdir({str(tmp_path)!r})\n{block}\nassert latents.shape == (1, 240, 100)"
    done = execute([sys.executable, "-I", "-c", code], smoke_runs)
    assert done.returncode == 0, done.stderr
    for to, out in {"savedmodel": "served", "tflite": "step.tflite"}.items():
        command = [*export[:-1], to, "--out", str(tmp_path / out)]
        done = execute([".venv/bin/dsnet", *command], smoke_runs)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / out).exists()
