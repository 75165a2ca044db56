"""One reading's training: its trainer, its losses, and the checkpoint from which it goes on."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from bridge.exchange import load_weights, save_weights
from bridge.motion.clips import Clips
from tf_dsnet.trainer import Trainer


class Course:
    """Epochs of one trainer, continued where a checkpoint left off.

    Parameters
    ----------
    trainer : DSNet and its optimizer.
    validation : clips that are only looked at.
    checkpoint : file that `save` writes; if it is there, the course goes on from it.
    """

    def __init__(self, trainer: Trainer, validation: Clips, checkpoint: Path) -> None:
        self.trainer = trainer
        self.losses: list[float] = []
        """Of every epoch so far."""
        self.validation_losses: list[float] = []
        """Of every epoch that was validated."""
        self.seconds = 0.0
        """Spent in this process."""
        self._validation, self._checkpoint = validation, checkpoint
        if checkpoint.exists():
            self._resume()
        self._first = len(self.losses)

    def epoch(self, number: int, validate: bool) -> None:
        """Train for epoch `number`, unless the checkpoint was behind it already."""
        if number < len(self.losses):
            return
        started = time.perf_counter()
        self.losses.append(self.trainer.epoch(number))
        if validate:
            self.validation_losses.append(self.trainer.loss(self._validation))
        self.seconds += time.perf_counter() - started

    def save(self) -> None:
        """Write the checkpoint."""
        history = {
            "history/loss": np.array(self.losses),
            "history/validation_loss": np.array(self.validation_losses),
        }
        save_weights(self._checkpoint, {**self.trainer.state(), **history})

    @property
    def epoch_s(self) -> float | None:
        """Mean seconds of this process's epochs; None if there were none."""
        trained = len(self.losses) - self._first
        return self.seconds / trained if trained else None

    def _resume(self) -> None:
        state = load_weights(self._checkpoint)
        self.losses, self.validation_losses = (
            state.pop(f"history/{name}").tolist() for name in ("loss", "validation_loss")
        )
        self.trainer.restore(state)
