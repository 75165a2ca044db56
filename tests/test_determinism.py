"""Two processes that train the same at the same time leave the same bytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bridge.runs.files import file_sha256

AUTOENCODER = """
import sys, numpy, torch
from pathlib import Path
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.codes import Normaliser
from bridge.motion.splits import split_frames
from torch_align_ae.autoencoder.training import Training, TrainingPlan

torch.manual_seed(0)
offsets = numpy.random.default_rng(0).standard_normal((100, 6890, 3), numpy.float32)
normaliser = Normaliser(torch.zeros(6890, 3), torch.ones(6890, 3))
plan = TrainingPlan(steps=4, batch_size=32)
network = MeshAutoencoder((6890, 300, 200, 100, 30))
split = split_frames(numpy.arange(100), 0)
Training(network, normaliser, offsets, split, plan, Path(sys.argv[1])).run()
"""
DSNET = """
import sys, numpy
from bridge.exchange import save_weights
from bridge.exchange.dsnet import Clips
from tf_dsnet.trainer import Trainer

rng = numpy.random.default_rng(0)
motion, latents = (rng.standard_normal((20, 300, size), numpy.float32) for size in (79, 100))
trainer = Trainer(Clips(motion, latents, numpy.ones((20, 300), bool)), lr=1e-3, seed=0)
for number in range(3):
    trainer.epoch(number)
save_weights(sys.argv[1], trainer.state())
"""


@pytest.mark.slow
@pytest.mark.parametrize("training", [AUTOENCODER, DSNET], ids=["autoencoder", "dsnet"])
def test_weights_and_moments_are_the_same_bytes(training: str, tmp_path: Path):
    files = [tmp_path / f"{name}.safetensors" for name in ("one", "two")]
    processes = [subprocess.Popen([sys.executable, "-c", training, str(file)]) for file in files]
    assert [process.wait() for process in processes] == [0, 0]
    assert file_sha256(files[0]) == file_sha256(files[1])
