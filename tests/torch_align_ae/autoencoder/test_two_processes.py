"""Two processes under `torchrun` train what one process trains, and go on where it stopped."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge.exchange import load_weights
from bridge.runs import Run
from tests.torch_align_ae.autoencoder.test_stages import leave_align

pytestmark = pytest.mark.slow  # each start of two processes loads PyTorch thrice

_TRAINING = """
import sys, numpy, torch
from pathlib import Path
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.codes import Normaliser
from torch_align_ae.autoencoder.training import Training, TrainingPlan
from torch_align_ae.workers import joined_by_torchrun, leads
from bridge.motion.splits import split_frames

checkpoint, steps = Path(sys.argv[1]), int(sys.argv[2])
torch.manual_seed(0)
torch.set_num_threads(1)
offsets = numpy.random.default_rng(0).standard_normal((100, 900, 3), numpy.float32)
normaliser = Normaliser(torch.zeros(900, 3), torch.ones(900, 3))
network = MeshAutoencoder((900, 300, 200, 100, 30))
split = split_frames(numpy.arange(100), 0)
# 70 frames in batches of 32: the last of an epoch has 6, of which two processes take 3 each.
plan = TrainingPlan(steps=steps, batch_size=32, validate_every=5)  # Adam at 1e-4
with joined_by_torchrun():
    Training(network, normaliser, offsets, split, plan, checkpoint).run()
    if leads():
        with torch.no_grad():
            numpy.save(checkpoint.with_suffix(".npy"), network(torch.from_numpy(offsets)))
"""
LEARNING_RATE = 1e-4
_TORCHRUN = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    script = tmp_path_factory.mktemp("training") / "train.py"
    script.write_text(_TRAINING)

    def run(checkpoint: Path, steps: int, *launcher: str) -> dict[str, np.ndarray]:
        command = [sys.executable, *launcher, str(script), str(checkpoint), str(steps)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        rebuilt = np.load(checkpoint.with_suffix(".npy"))
        return {"rebuilt": rebuilt, **load_weights(checkpoint)}

    return run


@pytest.fixture(scope="module")
def alone(train, tmp_path_factory):
    return train(tmp_path_factory.mktemp("alone") / "a.safetensors", 20)


def test_two_processes_give_what_one_gives(train, alone, tmp_path):
    together = train(tmp_path / "a.safetensors", 20, *_TORCHRUN)
    _assert_same(together, alone)


def test_each_goes_on_from_the_others_checkpoint(train, alone, tmp_path):
    train(tmp_path / "a.safetensors", 5)
    train(tmp_path / "a.safetensors", 15, *_TORCHRUN)
    _assert_same(train(tmp_path / "a.safetensors", 20), alone)


def test_the_documented_command_trains(tmp_path, monkeypatch):
    """As `docs/scaling.md` has it, whatever options of its own torchrun has by now."""
    page = (Path(__file__).parents[3] / "docs" / "scaling.md").read_text(encoding="utf-8")
    (line,) = re.findall("^torchrun .*train-ae.*$", page, re.MULTILINE)
    *command, script = shlex.split(line, comments=True)
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path))
    leave_align(Run("demo"))
    tools = str(Path(sys.executable).parent)
    environment = {"PATH": f"{tools}:{os.environ['PATH']}", "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [*command, f"{script} --steps 2"],
        capture_output=True, text=True, check=False, env={**os.environ, **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert Run("demo").artifact("train-ae").manifest["autoencoder"]["steps_taken"] == 2


def _assert_same(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    """The same losses and the same network. Of single weights whose gradient is next to nothing
    Adam takes the sign, and so the rounding: those may be apart by part of a step."""
    assert found.keys() == expected.keys()
    np.testing.assert_array_equal(found["history.steps"], expected["history.steps"])
    for name in ("history.losses", "history.validation_losses", "rebuilt"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-5, err_msg=name)
    for name in (name for name in expected if name.startswith("model.")):
        apart = np.abs(found[name] - expected[name])
        assert np.quantile(apart, 0.999) < 1e-5, name
        assert apart.max() < LEARNING_RATE, name
