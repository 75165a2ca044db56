"""One training of the mesh autoencoder, in one process or several that share each batch."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from tyro.conf import Fixed

from bridge.motion import sequences_of
from bridge.motion.splits import (
    FrameSplit,
    SplitName,
    held_out_frames,
    split_autoencoder_frames,
)
from bridge.options import NonNegativeInt, PositiveInt, Seed
from bridge.paper import ALTERNATIVE_WIDTHS, INFERRED_WIDTHS
from bridge.runs import Artifact, ArtifactWriter
from torch_align_ae.autoencoder.codec import Codec
from torch_align_ae.autoencoder.initialisation import SAMPLE_FRAMES, initialise_with_modes
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder
from torch_align_ae.autoencoder.normaliser import Normaliser, fit_normaliser
from torch_align_ae.autoencoder.pca import PcaCodec, reconstruction_r2
from torch_align_ae.autoencoder.presets import PRESETS, PresetName, TrainingPreset
from torch_align_ae.autoencoder.training import Training, TrainingPlan, TrainingResult
from torch_align_ae.workers import Processes


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """What all trainings of a stage have in common."""

    seed: Seed = 0
    """Decides the split, the weights' beginning and the order of frames."""
    architecture: Literal["inferred", "alternative"] = "inferred"
    """Widths 2000-1300-300-30, or 2000-1250-400-20: the same number of parameters."""
    batch_size: PositiveInt = 64
    """Frames a step; the paper's is 64."""
    steps: NonNegativeInt = 0
    """Optimiser steps; 0: as many as `epochs` make."""
    epochs: NonNegativeInt = 100
    """Passes over the training frames when `steps` is 0."""
    stop_epoch: Fixed[NonNegativeInt] = 0
    """Epoch after which the training, not `comparisons`, ends with the learning rate that it has on
    the way to `epochs`: what a long run is so far, to the bit; 0: never."""
    validate_every: Fixed[NonNegativeInt] = 0
    """Steps between two validation losses, the best of which decides what is kept; 0: an epoch."""
    patience: Fixed[NonNegativeInt] = 10
    """Validation losses without a better one after which training stops; 0: never."""
    validation_frames: Fixed[NonNegativeInt] = 0
    """Validation frames scored each time; 0: all. The final score always takes all."""


@dataclass(frozen=True)
class Trial:
    """What one training has to itself."""

    name: str
    """Of its checkpoint and in the manifest."""
    preset: PresetName
    """How the paper's silences are filled."""
    split: SplitName
    """Whether frames or whole sequences are drawn."""
    include_held_out: bool
    """Whether from the validation sequences too."""


@dataclass(frozen=True)
class Job:
    """What the leader of several processes is about to train."""

    options: TrialOptions
    trial: Trial
    checkpoint: Path


def follow(align: Artifact, processes: Processes) -> None:
    """Share the leader's work until it says that there is no more."""
    nothing: Job | None = None
    while job := processes.told(nothing):
        _training(job, _beginning(job, align), processes).run()


@dataclass(frozen=True)
class _Beginning:
    """A network before its first step, and what it will see."""

    codec: Codec
    offsets_m: NDArray[np.float32]
    split: FrameSplit


def _beginning(job: Job, align: Artifact) -> _Beginning:
    options, trial = job.options, job.trial
    offsets_m, preset = align.array("offsets"), PRESETS[trial.preset]
    split = split_of(options, trial, align)
    normaliser = fit_normaliser(preset.normalisation, offsets_m, split.train)
    model = _new_model(options, preset, normaliser, offsets_m, split)
    return _Beginning(Codec(model, normaliser), offsets_m, split)


def _training(job: Job, beginning: _Beginning, processes: Processes) -> Training[MeshAutoencoder]:
    trial, split = job.trial, beginning.split
    return Training(
        beginning.codec.model.to("cuda" if torch.cuda.is_available() else "cpu"),
        beginning.codec.normaliser,
        beginning.offsets_m,
        split,
        plan_of(job.options, PRESETS[trial.preset], len(split.train)),
        job.checkpoint,
        label=f"train-ae {trial.name}",
        processes=processes,
    )


def run_trial(
    options: TrialOptions,
    trial: Trial,
    align: Artifact,
    writer: ArtifactWriter,
    processes: Processes,
) -> tuple[Codec, TrainingResult, dict[str, Any]]:
    """Train, or go on from the writer's checkpoint; the last is what the manifest says of it."""
    checkpoint = writer.checkpoints.resolve() / f"{trial.name}.safetensors"
    job = processes.told(Job(options, trial, checkpoint))
    beginning = _beginning(job, align)
    codec, offsets_m, split = beginning.codec, beginning.offsets_m, beginning.split
    initial_r2 = reconstruction_r2(codec, offsets_m, split.validation)
    training = _training(job, beginning, processes)
    started = time.perf_counter()
    result = training.run()
    writer.record_measured(**{f"{trial.name}_training_s": round(time.perf_counter() - started, 2)})
    codec.model.cpu().eval()
    summary = {
        "name": trial.name,
        "preset": trial.preset,
        **asdict(PRESETS[trial.preset]),
        "loss": "mean squared error of normalised offsets",
        "split": trial.split,
        "train_frames": len(split.train),
        "validation_frames": len(split.validation),
        "steps": training.plan.steps,
        "learning_rate": float(training.learning_rate),
        "steps_taken": int(result.steps[-1]),
        "best_step": int(result.steps[result.best]),
        "loss_initial": float(result.validation_losses[0]),
        "loss_best": float(result.validation_losses[result.best]),
        "r2_initial": initial_r2,
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
        "include_held_out": trial.include_held_out,
        "r2_held_out": r2_held_out(codec, align),
    }
    return codec, result, summary


def plan_of(options: TrialOptions, preset: TrainingPreset, train_frames: int) -> TrainingPlan:
    """The plan of one preset under the stage's budget."""
    per_epoch = math.ceil(train_frames / options.batch_size)
    return TrainingPlan(
        steps=options.steps or options.epochs * per_epoch,
        stop=options.stop_epoch * per_epoch,
        batch_size=options.batch_size,
        learning_rate=preset.learning_rate,
        learning_rate_of_loss=preset.learning_rate_of_loss,
        warmup_steps=preset.warmup_steps,
        cosine_decay=preset.cosine_decay,
        validate_every=options.validate_every,
        patience=options.patience,
        validation_frames=options.validation_frames,
        seed=options.seed,
    )


def split_of(options: TrialOptions, trial: Trial, align: Artifact) -> FrameSplit:
    """Frames that one training is given, and those that it is validated on."""
    return split_autoencoder_frames(
        sequences_of(align), options.seed, by=trial.split, include_held_out=trial.include_held_out
    )


def _new_model(
    options: TrialOptions,
    preset: TrainingPreset,
    normaliser: Normaliser,
    offsets_m: NDArray[np.float32],
    split: FrameSplit,
) -> MeshAutoencoder:
    widths = INFERRED_WIDTHS if options.architecture == "inferred" else ALTERNATIVE_WIDTHS
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.seed)
        model = MeshAutoencoder(widths, preset.activation, preset.negative_slope)
    if preset.initialisation == "modes":
        count = min(SAMPLE_FRAMES, len(split.train))
        frames = np.random.default_rng(options.seed).choice(split.train, count, replace=False)
        sample = torch.from_numpy(np.asarray(offsets_m[np.sort(frames)], dtype=np.float32))
        initialise_with_modes(model, normaliser.normalise(sample), options.seed)
    return model


def r2_held_out(codec: Codec | PcaCodec, align: Artifact) -> float | None:
    """R2 on the sequences that are held out; None if there are none."""
    frames = held_out_frames(sequences_of(align))
    return reconstruction_r2(codec, align.array("offsets"), frames) if len(frames) else None
