"""Trainings of one code and size: what all are given alike, and the search for a rate."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from benchmarks.subspaces.codes import OffsetAutoencoder, SubspaceCode, new_network
from benchmarks.subspaces.data import SubspaceData
from bridge.errors import DsnetError
from bridge.runs.files import write_text_atomically
from torch_align_ae.autoencoder.stage_train_ae import PRESETS
from torch_align_ae.autoencoder.training import Training, TrainingPlan
from torch_align_ae.workers import device

OffsetTraining: TypeAlias = Training[OffsetAutoencoder]


@dataclass(frozen=True)
class Budget:
    """What every network is given alike."""

    steps: int
    """Of the training."""
    search_steps: int
    """Of each rate that is tried."""
    rates: tuple[float, ...]
    """Learning rates that are tried where the rate is searched for."""
    batch_size: int
    """Frames a step."""
    validate_every: int
    """Steps between two validation losses."""
    validation_frames: int
    """Validation frames scored each time."""


@dataclass(frozen=True)
class UntrainedCode:
    """A code of one size that is to be trained."""

    code: SubspaceCode
    size: int
    data: SubspaceData
    budget: Budget
    checkpoint: Path
    """What a killed training goes on from; further files beside it begin with its stem."""

    def rate(self, tried: dict[str, float | None]) -> float:
        """The best rate of a search, or the preset's if there was none.

        Raises
        ------
        DsnetError
            If every training of the search diverged.
        """
        if not tried:
            return PRESETS[self.code.preset].learning_rate
        finite = {rate: loss for rate, loss in tried.items() if loss is not None}
        if not finite:
            raise DsnetError(
                f"{self.code.label}, whose training diverges at {', '.join(tried)}",
                "a rate at which it does not",
                "Pass lower --rates.",
            )
        return float(min(finite, key=lambda rate: finite[rate]))

    def search(self) -> dict[str, float | None]:
        """Validation loss after a short training at each rate; None where it diverged."""
        if not self.code.searched:
            return {}
        known = self.checkpoint.with_suffix(".search.json")
        tried: dict[str, float | None] = (
            json.loads(known.read_text(encoding="utf-8")) if known.is_file() else {}
        )
        for rate in self.budget.rates:
            name = f"{rate:g}"
            if name not in tried:
                own = self.checkpoint.with_name(
                    f"{self.checkpoint.stem}-at-{name}{self.checkpoint.suffix}"
                )
                tried[name] = _last_loss(self.training(rate, self.budget.search_steps, own))
                write_text_atomically(known, json.dumps(tried, allow_nan=False))
                remove_all(own)
        return tried

    def training(self, rate: float, steps: int, checkpoint: Path) -> OffsetTraining:
        """A training from the beginning, or from the checkpoint if there is one."""
        preset, budget = PRESETS[self.code.preset], self.budget
        plan = TrainingPlan(
            steps=steps,
            batch_size=budget.batch_size,
            learning_rate=rate,
            warmup_steps=preset.warmup_steps,
            cosine_decay=preset.cosine_decay,
            validate_every=budget.validate_every,
            validation_frames=budget.validation_frames,
            seed=self.data.seed,
        )
        model, normaliser = new_network(self.code, self.size, self.data)
        model.to(device())
        label = f"{checkpoint.stem} at {rate:g}"
        offsets_m, split = self.data.offsets_m, self.data.split
        return Training(model, normaliser, offsets_m, split, plan, checkpoint, label)


def remove_all(checkpoint: Path) -> None:
    """Remove a checkpoint and the files that a training left beside it."""
    for path in checkpoint.parent.glob(f"{checkpoint.stem}.*"):
        path.unlink()


def _last_loss(training: OffsetTraining) -> float | None:
    # Validated once, at the end: each validation writes a checkpoint, gigabytes for Casas-Otaduy.
    training.plan = replace(training.plan, validate_every=training.plan.steps)
    try:
        return float(training.run().validation_losses[-1])
    except DsnetError:  # a loss or a weight that is no number
        return None
