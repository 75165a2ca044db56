"""A row of the comparison: a code of one size fitted, trained where it is a network, and scored."""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import numpy as np

from benchmarks.speed.autoencoder import gpu_name
from benchmarks.subspaces.data import SubspaceData
from benchmarks.subspaces.scores import NetworkCodec, errors, measured
from benchmarks.subspaces.trainings import Budget, OffsetTraining, UntrainedCode
from bridge.motion.splits import chunks
from torch_align_ae.autoencoder.mesh_autoencoder import parameter_count
from torch_align_ae.autoencoder.training import TrainingResult, scored_frames


def pca_row(size: int, data: SubspaceData, budget: Budget) -> dict[str, Any]:
    """PCA: the leading components of one fit, scored."""
    codec = data.leading(size)
    scored = scored_frames(data.split, budget.validation_frames)
    return {
        "parameters": codec.components.size + codec.mean_m.size,
        "fit_s": data.fit_s,
        "scored_r2": errors(codec, data.offsets_m, scored)["r2"],
        **measured(codec, data),
    }


def network_row(code: UntrainedCode) -> dict[str, Any]:
    """A network: its rate searched for if asked, trained, and scored with its best weights.

    Seconds are those of the process that ends the training: of as many steps as it says.
    """
    tried = code.search()
    rate = code.rate(tried)
    training = code.training(rate, code.budget.steps, code.checkpoint)
    started = time.perf_counter()
    result = training.run()
    training_s = time.perf_counter() - started
    training.model.eval()
    gpu = gpu_name()
    return {
        "parameters": parameter_count(training.model),
        "learning_rate": rate,
        "searched": tried,
        "steps_taken": int(result.steps[-1]),
        "best_step": int(result.steps[result.best]),
        "timed_steps": len(training.step_s),
        # Of a GPU a step's seconds are only those to ask for it.
        "step_s": median(training.step_s) if training.step_s and not gpu else None,
        "training_s": training_s,
        "gpu": gpu,
        "curve": {"steps": result.steps.tolist(), "r2": _curve(training, result)},
        **measured(NetworkCodec(training.model, training.normaliser), code.data),
    }


def _curve(training: OffsetTraining, result: TrainingResult) -> list[float]:
    """R2 of the scored validation frames, in metres, at each validation."""
    scale_m = training.normaliser.scale_m
    if scale_m.min() != scale_m.max():
        raise ValueError("a normaliser with several scales, whose loss is no error in metres")
    scored = scored_frames(training.split, training.plan.validation_frames)
    parts = chunks(training.offsets_m, scored)
    energy = sum(float(np.square(part, dtype=np.float64).sum()) for part in parts)
    coordinates = len(scored) * scale_m.numel()
    error = result.validation_losses * coordinates * float(scale_m.max()) ** 2
    return (1 - error / energy).tolist()
