"""A GPU trains what the processor trains, again and again the same, and no file asks for one."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from bridge.exchange import load_weights
from bridge.paper import INFERRED_WIDTHS
from bridge.runs import Run, read_artifact
from tests.torch_align_ae.autoencoder.test_stages import CONFIG, leave_align
from tests.torch_align_ae.autoencoder.test_training import smooth_offsets, training
from torch_align_ae.autoencoder.training import TrainingPlan

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="PyTorch finds no GPU"),
]
DSNET = (sys.executable, "-m", "dsnet.cli")


def test_full_size_steps_are_those_of_the_processor(tmp_path):
    plan = TrainingPlan(steps=8, batch_size=16, validate_every=2)  # Adam at 1e-4
    found = {}
    for where in ("cpu", "cuda"):
        (folder := tmp_path / where).mkdir()
        job = training(folder, plan, smooth_offsets(60, 6890), INFERRED_WIDTHS, where)
        found[where] = job.run()
    np.testing.assert_allclose(found["cuda"].losses, found["cpu"].losses, rtol=1e-5)
    np.testing.assert_allclose(
        found["cuda"].validation_losses, found["cpu"].validation_losses, rtol=1e-5
    )
    assert len(set(found["cpu"].losses)) == 4  # it moves


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder of runs, and the weights that `train-ae` leaves in each of two."""
    folder = tmp_path_factory.mktemp("runs")
    weights = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(folder))
        for name in ("here", "again"):
            leave_align(Run(name))
            command = [*DSNET, "train-ae", "--steps", str(CONFIG.steps), "--run", name]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            weights[name] = load_weights(Run(name).path / "train-ae" / "autoencoder.safetensors")
        yield folder, weights


def test_two_runs_have_the_same_bits(trained):
    _, weights = trained
    for name, value in weights["here"].items():
        np.testing.assert_array_equal(weights["again"][name], value, err_msg=name)


def test_what_a_gpu_trained_is_read_without_one(trained):
    folder, _ = trained
    environment = {**os.environ, "DSNET_RUNS": str(folder), "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [*DSNET, "encode", "--run", "here"],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = read_artifact(folder / "here" / "train-ae").manifest["autoencoder"]
    assert summary["precision"] == "float32"
