"""Training of an autoencoder: Adam on the mean squared error of normalised offsets.

The paper states optimiser, learning rate, batch size and split (Section 5) but not the loss; the
mean squared error is the usual choice.
"""

from __future__ import annotations

import ctypes
import math
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from tqdm import tqdm
from tyro.conf import Fixed

from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.weights import load_checkpoint, refuse_nonfinite, save_checkpoint
from bridge.motion.splits import FrameSplit, chunks
from bridge.options import NonNegativeInt, PositiveInt, Seed
from torch_align_ae.autoencoder.codes import Normaliser

_VALIDATION_BATCH = 64
_MOMENTS = ("exp_avg", "exp_avg_sq")
_REMEDY = "Train with another --preset, whose learning rate is lower."

Network = TypeVar("Network", bound=nn.Module)
"""Reconstructs normalised offsets (B, V, 3)."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Adam's learning rate over a training."""

    learning_rate: float = 1e-4  # the largest; the paper's is 1e-4
    learning_rate_of_loss: float = 0.0
    """If not 0, the largest rate is this times the validation loss before the first step."""
    warmup_steps: int = 0  # over which the rate rises linearly
    cosine_decay: bool = False  # whether the rate then falls to zero along a cosine


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """Options of a training: its length, batches and validation."""

    seed: Seed = 0
    """Seed of the split, the initial weights and the order of frames."""
    steps: NonNegativeInt = 0
    """Optimiser steps; 0: as many as --epochs make."""
    batch_size: Fixed[PositiveInt] = 64
    """Frames a step; the paper's is 64."""
    validate_every: Fixed[NonNegativeInt] = 0
    """Steps between validation losses, by the best of which weights are kept; 0: an epoch."""
    patience: Fixed[NonNegativeInt] = 0
    """Number of validation losses without improvement after which training stops; 0: never."""
    validation_frames: Fixed[NonNegativeInt] = 0
    """Validation frames of these losses, evenly spaced; 0: all. The final score uses all."""


@dataclass(frozen=True, kw_only=True)
class TrainingPlan(Schedule, TrainingOptions):
    """All options and the learning rate of one training."""

    steps: int = field()
    """Optimiser steps in all; the last epoch may be incomplete."""
    bfloat16: bool = False
    """Whether training steps multiply bfloat16 matrices; weights, their sums and validation stay
    float32."""

    def rate_factor(self, step: int) -> float:
        """Learning rate of a step, counted from 0, relative to the largest one."""
        if step < self.warmup_steps:
            return (step + 1) / self.warmup_steps
        if not self.cosine_decay:
            return 1.0
        progress = (step - self.warmup_steps) / max(self.steps - self.warmup_steps, 1)
        return 0.5 * (1 + math.cos(math.pi * progress))


@dataclass(frozen=True)
class TrainingResult:
    """Losses of a training; the model then has the weights of the least validation loss."""

    losses: NDArray[np.float64]  # (R,) mean training loss of the steps before each validation
    validation_losses: NDArray[np.float64]  # (R + 1,); the first is before the first step
    steps: NDArray[np.int64]  # (R + 1,) steps taken at each validation

    @property
    def best(self) -> int:
        """Row of `validation_losses` whose weights were kept."""
        return int(np.argmin(self.validation_losses))


@dataclass
class Training(Generic[Network]):
    """Training of one model by a plan; after an interruption `run` continues from the checkpoint.

    Creating it makes the process compute reproducibly, and moves `normaliser` to the model's
    device. The best weights so far are in a file beside the checkpoint, not in memory, where
    weights, gradients and Adam's moments already take four times the size of the model.
    """

    model: Network
    normaliser: Normaliser
    offsets_m: NDArray[np.float32]
    split: FrameSplit
    plan: TrainingPlan
    checkpoint: Path
    label: str = "autoencoder"

    learning_rate: float = field(init=False)  # the largest one
    step_s: list[float] = field(init=False, default_factory=list)
    """Seconds of each step in this process; on a GPU only the time to launch it."""

    def __post_init__(self) -> None:
        compute_reproducibly()
        self.learning_rate = self.plan.learning_rate
        self._device = next(self.model.parameters()).device
        self.normaliser.to(self._device)
        # One fused pass over weights and moments, which is bit-reproducible and twice as fast.
        self._adam = torch.optim.Adam(self.model.parameters(), self.learning_rate, fused=True)
        self._scored = scored_frames(self.split, self.plan.validation_frames)

    def run(self) -> TrainingResult:
        """Train to the end of the plan, from the checkpoint if there is one."""
        result = self._start()
        if self.plan.learning_rate_of_loss:
            self.learning_rate = self.plan.learning_rate_of_loss * result.validation_losses[0]
        done, end, patience = int(result.steps[-1]), self.plan.steps, self.plan.patience
        with tqdm(total=end, initial=done, desc=self.label, unit="step", disable=None) as bar:
            while done < end and not 0 < patience <= len(result.losses) - result.best:
                upto = min(done + (self.plan.validate_every or self._epoch_steps), end)
                loss = self._train(range(done, upto), bar)
                done = upto
                loss = self._finite(loss, "loss", done)
                validation = self._finite(self.validation_loss(), "validation loss", done)
                result = TrainingResult(
                    np.append(result.losses, loss),
                    np.append(result.validation_losses, validation),
                    np.append(result.steps, done),
                )
                if result.best == len(result.losses):
                    self._keep_best()
                self._save(result)
                bar.set_postfix(validation=f"{validation:.4f}")
        best = load_weights(self.best_file)
        refuse_nonfinite(best, self.label, _REMEDY)
        self._assign(best)
        return result

    @property
    def best_file(self) -> Path:
        return self.checkpoint.with_suffix(f".best{self.checkpoint.suffix}")

    @property
    def _epoch_steps(self) -> int:
        return math.ceil(len(self.split.train) / self.plan.batch_size)

    def _start(self) -> TrainingResult:
        state = load_checkpoint(self.checkpoint)
        if state is not None and load_checkpoint(self.best_file) is not None:
            return self._restored(state)
        loss = self._finite(self.validation_loss(), "validation loss", 0)
        self._keep_best()
        return TrainingResult(np.empty(0), np.array([loss]), np.array([0]))

    def _finite(self, loss: float, what: str, step: int) -> float:
        if not math.isfinite(loss):
            raise DsnetError(
                f"{self.label} with a {what} of {loss} after step {step}", "a number", _REMEDY
            )
        return loss

    def _train(self, steps: range, bar: tqdm) -> float:
        self.model.train()
        total = torch.zeros((), dtype=torch.float64, device=self._device)
        for step, batch in zip(steps, self._batches(steps.start), strict=False):
            started = time.perf_counter()
            for group in self._adam.param_groups:
                group["lr"] = self.learning_rate * self.plan.rate_factor(step)
            self._adam.zero_grad()
            with torch.autocast(self._device.type, torch.bfloat16, enabled=self.plan.bfloat16):
                loss = self._loss(batch)
            loss.backward()
            self._adam.step()
            total += loss.detach()
            self.step_s.append(time.perf_counter() - started)
            bar.update()
        self._adam.zero_grad()  # validation and checkpoint need the memory, not the gradients
        return total.item() / len(steps)

    def _batches(self, start: int) -> Iterator[Tensor]:
        """Batches from step `start` on, in an order that the epoch and the seed decide."""
        epoch, skipped = divmod(start, self._epoch_steps)
        while True:
            epoch += 1
            order = np.random.default_rng([self.plan.seed, epoch]).permutation(self.split.train)
            left = order[skipped * self.plan.batch_size :]
            for part in chunks(self.offsets_m, left, self.plan.batch_size):
                yield torch.from_numpy(part).to(self._device)
            skipped = 0

    def _loss(self, offsets_m: Tensor) -> Tensor:
        values = self.normaliser.normalise(offsets_m)
        return nn.functional.mse_loss(self.model(values), values)

    @torch.inference_mode()
    def validation_loss(self) -> float:
        """Mean squared error of the scored validation frames, normalised."""
        self.model.eval()
        total = 0.0
        for part in chunks(self.offsets_m, self._scored, _VALIDATION_BATCH):
            offsets_m = torch.from_numpy(part).to(self._device)
            total += self._loss(offsets_m).item() * len(part)
        return total / len(self._scored)

    def _keep_best(self) -> None:
        weights = {name: _numpy(value) for name, value in self.model.named_parameters()}
        save_checkpoint(self.best_file, weights)

    def _save(self, result: TrainingResult) -> None:
        """Write weights, Adam's moments and losses atomically.

        There is no random state: the order of each epoch follows from the seed and its number.
        """
        arrays = {f"history.{name}": array for name, array in vars(result).items()}
        for name, parameter in self.model.named_parameters():
            arrays[f"model.{name}"] = _numpy(parameter)
            for moment in _MOMENTS:
                arrays[f"{moment}.{name}"] = _numpy(self._adam.state[parameter][moment])
        save_checkpoint(self.checkpoint, arrays)

    def _restored(self, arrays: dict[str, NDArray]) -> TrainingResult:
        """Continue from the arrays that `_save` wrote."""
        result = TrainingResult(*(arrays[f"history.{f.name}"] for f in fields(TrainingResult)))
        named = dict(self.model.named_parameters())
        self._assign({name: arrays.pop(f"model.{name}") for name in named})
        for name, parameter in named.items():
            state = self._adam.state[parameter]
            state["step"] = torch.tensor(float(result.steps[-1]), device=self._device)
            for moment in _MOMENTS:
                state[moment] = torch.from_numpy(arrays[f"{moment}.{name}"]).to(self._device)
        return result

    def _assign(self, weights: dict[str, NDArray]) -> None:
        named = dict(self.model.named_parameters())
        if missing := ", ".join(sorted(named.keys() - weights)):
            raise DsnetError(
                f"{self.best_file} without {missing}", "all weights", "Remove it to train anew."
            )
        tensors = {name: torch.from_numpy(weights[name]) for name in named}
        self.model.load_state_dict(tensors, strict=False)  # buffers are not kept


def scored_frames(split: FrameSplit, most: int) -> NDArray[np.int64]:
    """Validation frames, evenly spaced, at most `most`; all if that is 0."""
    count = len(split.validation)
    return split.validation[np.linspace(0, count - 1, min(most or count, count)).astype(int)]


def _numpy(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().cpu().numpy()


def compute_reproducibly() -> None:
    """Make PyTorch compute the same bits in every run, for the rest of the process.

    A CPU needs only the same number of threads, by which sums are split; all random numbers have
    generators with the run's seed. On a GPU cuBLAS needs a fixed workspace, and operations that add
    in no fixed order are replaced or raise an error.
    """
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    torch.use_deterministic_algorithms(True)
    settings: Any = torch.utils.deterministic
    # No code here reads uninitialised memory, so filling it would only take time.
    settings.fill_uninitialized_memory = False


def multiplies_bfloat16() -> bool:
    """Whether this processor has instructions for products of bfloat16 matrices (`avx512_bf16`).

    Without them these would be slower than those of float32.
    """
    cpuinfo = Path("/proc/cpuinfo")
    return cpuinfo.is_file() and " avx512_bf16 " in cpuinfo.read_text(encoding="utf-8")


def keep_freed_memory() -> None:
    """Ask the C library to keep freed memory instead of returning it to the kernel.

    A training step frees and allocates half a gigabyte of activations and gradients. glibc maps
    blocks of this size anew each time, with 40,000 to 60,000 page faults a step, which are slow in
    a virtual machine. Kept memory has none. Without glibc this does nothing.
    """
    if platform.libc_ver()[0] == "glibc":
        trim_threshold, top_pad, mmap_max = -1, -2, -4
        libc = ctypes.CDLL(None)
        libc.mallopt(mmap_max, 0)
        libc.mallopt(trim_threshold, 1 << 30)
        libc.mallopt(top_pad, 1 << 26)
