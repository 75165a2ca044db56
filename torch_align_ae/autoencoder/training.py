"""Training of the mesh autoencoder: Adam on the mean squared error of normalised offsets.

The paper gives optimiser, learning rate, batch size and split (Section 5) but
not the loss; the mean squared error is the usual one, and ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from tqdm import tqdm

from bridge.motion.splits import FrameSplit, chunks
from torch_align_ae.autoencoder.checkpoint import load_checkpoint, save_checkpoint
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.normaliser import Normaliser
from torch_align_ae.determinism import reproducible

_VALIDATION_BATCH = 64


@dataclass(frozen=True)
class TrainingPlan:
    """How long and how fast to train."""

    steps: int
    """Optimiser steps in all; the last epoch may be a part of one."""
    batch_size: int = 64
    """Frames a step; the paper's is 64."""
    learning_rate: float = 1e-4
    """Adam's largest learning rate; the paper's is 1e-4."""
    warmup_steps: int = 0
    """Steps over which the learning rate rises linearly."""
    cosine_decay: bool = False
    """Whether the learning rate then falls to zero along a cosine."""
    patience: int = 0
    """Epochs without a better validation loss after which training stops; 0: never."""
    validation_frames: int = 0
    """Validation frames scored after each epoch, evenly spaced; 0: all."""
    seed: int = 0
    """Decides the order of frames."""

    def learning_rate_at(self, step: int) -> float:
        """Learning rate of the step with this number, counted from 0."""
        if step < self.warmup_steps:
            return self.learning_rate * (step + 1) / self.warmup_steps
        if not self.cosine_decay:
            return self.learning_rate
        progress = (step - self.warmup_steps) / max(self.steps - self.warmup_steps, 1)
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * progress))


@dataclass(frozen=True)
class TrainingResult:
    """What training leaves behind; the model holds the best epoch's weights."""

    history: NDArray[np.float64]
    """(epochs + 1, 2): training and validation loss; row 0 is before the first step."""
    best_epoch: int
    """Row of `history` whose weights were kept."""


@dataclass
class Training:
    """One model on its way through a plan; `run` may be killed and called again anywhere."""

    model: MeshAutoencoder
    normaliser: Normaliser
    offsets_m: NDArray[np.float32]
    split: FrameSplit
    plan: TrainingPlan
    checkpoint: Path
    label: str = "autoencoder"

    def __post_init__(self) -> None:
        self._device = next(self.model.parameters()).device
        self._normaliser = self.normaliser.to(self._device)
        # One fused pass over weights and moments; it is bit-reproducible and twice as fast.
        self._adam = torch.optim.Adam(self.model.parameters(), self.plan.learning_rate, fused=True)
        count = len(self.split.validation)
        self._scored = _spread(self.split.validation, self.plan.validation_frames or count)
        self._learned = _spread(self.split.train, len(self._scored))

    def run(self) -> TrainingResult:
        """Train to the end of the plan, from the checkpoint if there is one."""
        best, history, done = self._start()
        steps_per_epoch = math.ceil(len(self.split.train) / self.plan.batch_size)
        epochs = math.ceil(self.plan.steps / steps_per_epoch)
        bar = tqdm(total=self.plan.steps, initial=done, desc=self.label, unit="step", disable=None)
        with bar, reproducible():
            for epoch in range(len(history), epochs + 1):
                if self._stale(history):
                    break
                upto = min(epoch * steps_per_epoch, self.plan.steps)
                loss = self._epoch(epoch, range(done, upto), bar)
                history = np.vstack([history, [loss, self.validation_loss()]])
                done = upto
                if np.argmin(history[:, 1]) == epoch:
                    best = self._weights()
                save_checkpoint(self.checkpoint, self.model, self._adam, best, history, done)
                bar.set_postfix(validation=f"{history[-1, 1]:.4f}")
        self.model.load_state_dict(best)
        return TrainingResult(history, int(np.argmin(history[:, 1])))

    def _start(self) -> tuple[dict[str, Tensor], NDArray[np.float64], int]:
        if self.checkpoint.is_file():
            return load_checkpoint(self.checkpoint, self.model, self._adam)
        # As many training frames as validation ones: all of them would cost an epoch.
        losses = [self._mean_loss(self._learned), self.validation_loss()]
        return self._weights(), np.array([losses]), 0

    def _stale(self, history: NDArray[np.float64]) -> bool:
        since = len(history) - 1 - int(np.argmin(history[:, 1]))
        return 0 < self.plan.patience <= since

    def _epoch(self, epoch: int, steps: range, bar: tqdm) -> float:
        """Take the steps of one epoch; return their mean loss."""
        self.model.train()
        total = torch.zeros((), dtype=torch.float64, device=self._device)
        for step, batch in zip(steps, self._batches(epoch), strict=False):
            for group in self._adam.param_groups:
                group["lr"] = self.plan.learning_rate_at(step)
            self._adam.zero_grad()
            loss = self._loss(batch)
            loss.backward()
            self._adam.step()
            total += loss.detach()
            bar.update()
        return total.item() / max(len(steps), 1)

    def _batches(self, epoch: int) -> Iterator[Tensor]:
        """Frames of one epoch in an order that its number and the seed decide."""
        order = np.random.default_rng([self.plan.seed, epoch]).permutation(self.split.train)
        for part in chunks(self.offsets_m, order, self.plan.batch_size):
            yield torch.from_numpy(part).to(self._device)

    def _loss(self, offsets_m: Tensor) -> Tensor:
        values = self._normaliser.normalise(offsets_m)
        return nn.functional.mse_loss(self.model(values), values)

    def validation_loss(self) -> float:
        """Mean squared error of the scored validation frames, normalised."""
        return self._mean_loss(self._scored)

    @torch.inference_mode()
    def _mean_loss(self, frames: NDArray[np.int64]) -> float:
        self.model.eval()
        total = 0.0
        for part in chunks(self.offsets_m, frames, _VALIDATION_BATCH):
            total += self._loss(torch.from_numpy(part).to(self._device)).item() * len(part)
        return total / len(frames)

    def _weights(self) -> dict[str, Tensor]:
        return {name: value.detach().cpu().clone() for name, value in self.model.named_parameters()}


def _spread(frames: NDArray[np.int64], wanted: int) -> NDArray[np.int64]:
    """At most `wanted` frames, spread evenly."""
    return frames[np.linspace(0, len(frames) - 1, min(wanted, len(frames))).astype(int)]
