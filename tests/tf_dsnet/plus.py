"""A run whose robust alignment is forged, and small settings."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.body import load_body_model
from bridge.exchange.train_options import TrainPlusConfig
from bridge.tissue.nodes import TissueNodes
from dsnet.prediction.models import simulate_nodes
from dsnet.stages import run_motions, stage_infer
from tests.forged.oscillating import people_of, true_model, write_aligned
from tf_dsnet import train_plus as trainer
from tf_dsnet.train_plus import train_plus

TINY = TrainPlusConfig(
    run="tiny", nodes=60, rounds=3, steps=2, window=12, batch_size=4, taps=2, look_ahead=1
)
PEOPLE = 2


def train(config: TrainPlusConfig = TINY) -> None:
    """As `dsnet train` does."""
    train_plus(config, simulate_nodes)


def teach_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds that leave the weights as they start, where only what is around them matters."""
    losses = [1.0] * TINY.steps
    monkeypatch.setattr(trainer.PlusTraining, "round", lambda *_: losses)


def forge_run(runs: Path, monkeypatch: pytest.MonkeyPatch, **aligned) -> Path:
    """Run `tiny` with an `align_robust`; the body is the embedded one."""
    for stage in (trainer, stage_infer, run_motions):
        monkeypatch.setattr(stage, "body_model_path", lambda run: "embedded:female")
    body = load_body_model("embedded:female")
    model = true_model(TissueNodes.of(body, 60), people_of(PEOPLE))
    path = runs / "tiny" / aligned.get("kind", "align_robust")
    write_aligned(path, body, model, **aligned)
    return runs / "tiny"
