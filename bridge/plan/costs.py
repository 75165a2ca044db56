"""The work and the disk of every stage, from its settings and the sequences that it is given.

A stage's work is a number that its time is in proportion to; what the unit takes is measured
(`bridge.plan.rates`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from bridge.motion import MotionSequence
from bridge.motion.sequences import subjects_of
from bridge.motion.splits import TRAIN_TENTHS, decoded_sequences
from bridge.paper import LATENT_SIZE, N_VERTICES, THETA_SIZE, number

_FLOAT_BYTES = 4
MESH_BYTES = 3 * _FLOAT_BYTES * N_VERTICES
"""Of one frame's offsets or vertices."""
_FORWARD_SHARE = 1 / 3
"""Of a training step's arithmetic: gradients cost twice the forward pass."""
_CHECKPOINT_COPIES = 8
"""Weights, two moments and the best weights, and the file before while a new one is written."""

Settings = Mapping[str, Mapping[str, Any]]
"""By stage, as manifests hold them."""


@dataclass(frozen=True)
class Work:
    """What one stage has to do and leaves."""

    amount: float
    """How much, in the unit of the stage's rate."""
    text: str
    """The same for people."""
    disk_bytes: int = 0
    """Size of the artifact; what is less than a megabyte may be left out."""
    scratch_bytes: int = 0
    """What lies there besides only while the stage runs."""
    mapped_bytes: int = 0
    """Arrays in files that the stage maps into memory, and so may be resident."""


@dataclass(frozen=True)
class Rate:
    """What one stage took in the measured run."""

    seconds: float
    """Wall time."""
    amount: float
    """Work done in it: `Work.amount`."""
    memory_mb: int
    """Largest resident memory besides `Work.mapped_bytes`, MiB."""


@dataclass(frozen=True)
class MeasuredRun:
    """Where the rates are from."""

    run: str
    machine: str
    day: str
    """When it ended, UTC."""


@dataclass(frozen=True)
class Material:
    """The sequences of a run: those that are aligned, and those that are only predicted."""

    sequences: Sequence[MotionSequence]

    @cached_property
    def aligned(self) -> list[MotionSequence]:
        """Those with meshes: trained on, or held out."""
        return [sequence for sequence in self.sequences if sequence.split != "test"]

    @cached_property
    def trained(self) -> list[MotionSequence]:
        """Those that networks are trained on."""
        return [sequence for sequence in self.sequences if sequence.split == "train"]

    @cached_property
    def decoded(self) -> list[MotionSequence]:
        """Those whose offsets are predicted and measured."""
        return decoded_sequences(self.sequences)


def works(settings: Settings, material: Material) -> dict[str, Work]:
    """The work of each stage that has settings, in the order in which the stages are made."""
    return {stage: work(settings, material) for stage, work in _WORKS.items() if stage in settings}


def rate_name(stage: str, settings: Settings) -> str:
    """The stage whose rate holds: the robust aligner's artifact may be the run's only one."""
    return "align_robust" if settings[stage].get("aligner") == "robust" else stage


def frames_of(sequences: Iterable[MotionSequence]) -> int:
    """Frames of all of them."""
    return sum(sequence.length for sequence in sequences)


def _truth(settings: Settings, material: Material) -> Work:
    frames = frames_of(material.sequences)
    arrays = 2 if settings["truth"]["form"] == "captured" else 1
    size = arrays * frames * MESH_BYTES
    return Work(frames, f"{frames:,} frames", size, mapped_bytes=size)


def _corpus(settings: Settings, material: Material) -> Work:
    frames = frames_of(material.aligned)
    # One process makes both, and the largest memory of a process is never forgotten.
    mapped = _truth(settings, material).mapped_bytes
    return Work(frames, f"{frames:,} frames", frames * MESH_BYTES, mapped_bytes=mapped)


def _align(settings: Settings, material: Material) -> Work:
    own = settings["align"]
    if own["aligner"] == "robust":
        return _align_robust(settings, material)
    sequences, frames = len(material.aligned), frames_of(material.aligned)
    descent = (
        own["steps"] * (frames - sequences)
        + own["first_frame_steps"] * sequences
        + own["shape_steps"] * len(subjects_of(material.aligned))
    )
    size = frames * MESH_BYTES
    return Work(descent, f"{frames:,} frames of {own['steps']} steps", size, mapped_bytes=size)


def _align_robust(settings: Settings, material: Material) -> Work:
    frames = frames_of(material.aligned)
    size = frames * MESH_BYTES
    return Work(frames, f"{frames:,} frames", size, mapped_bytes=size)


def _train_ae(settings: Settings, material: Material) -> Work:
    own = settings["train-ae"]
    drawn_from = material.aligned if own["include_held_out"] else material.trained
    frames = frames_of(drawn_from)
    train = frames * TRAIN_TENTHS // 10
    epoch_steps = math.ceil(train / own["batch_size"])
    steps = own["steps"] or own["epochs"] * epoch_steps
    compared = own.get("comparison_epochs", 0) * epoch_steps or steps
    steps = min(own.get("stop_epoch", 0) * epoch_steps or steps, steps)
    scored = min(own["validation_frames"] or frames, frames - train)

    def passes(steps: int) -> float:
        validations = 1 + math.ceil(steps / (own["validate_every"] or epoch_steps))
        return steps * own["batch_size"] + _FORWARD_SHARE * validations * scored

    text = f"{steps:,} steps of {own['batch_size']}"
    text += "".join(f", {name} {compared:,}" for name in own["comparisons"])
    weights = _FLOAT_BYTES * _autoencoder_parameters()
    amount = passes(steps) + len(own["comparisons"]) * passes(compared)
    pca = LATENT_SIZE * MESH_BYTES
    scratch = _CHECKPOINT_COPIES * weights
    return Work(amount, text, weights + pca, scratch, _aligned_bytes(material))


def _aligned_bytes(material: Material) -> int:
    return frames_of(material.aligned) * MESH_BYTES


def _autoencoder_parameters() -> int:
    value = number("ae_parameters").value
    assert isinstance(value, int)
    return value


def _encode(settings: Settings, material: Material) -> Work:
    frames = frames_of(material.aligned)
    # Latents of the two codes that every run has.
    width = 2 * LATENT_SIZE + THETA_SIZE
    size, mapped = _FLOAT_BYTES * width * frames, _aligned_bytes(material)
    return Work(frames, f"{frames:,} frames", size, mapped_bytes=mapped)


def _train(settings: Settings, material: Material) -> Work:
    own, clips = settings["train"], len(material.trained)
    text = f"{own['epochs']:,} epochs of {clips} sequences, {len(own['predictors'])} networks"
    return Work(own["epochs"] * clips * len(own["predictors"]), text)


def _train_plus(settings: Settings, material: Material) -> Work:
    own = settings["train_plus"]
    learned = own["steps"] * own["batch_size"] * own["window"]
    simulated = frames_of(material.trained)
    a_round = learned + _FORWARD_SHARE * simulated
    text = f"{own['rounds']} rounds of {own['steps']} steps"
    amount = own["rounds"] * a_round * own["nodes"]
    return Work(amount, text, mapped_bytes=_aligned_bytes(material))


def _predict(settings: Settings, material: Material) -> Work:
    frames, networks = frames_of(material.sequences), len(settings["train"]["predictors"])
    width = networks * LATENT_SIZE + THETA_SIZE
    return Work(frames * networks, _in_arrays(frames, networks), _FLOAT_BYTES * width * frames)


def _predict_plus(settings: Settings, material: Material) -> Work:
    frames, arrays = frames_of(material.decoded), 1 + settings["train_plus"]["static"]
    size = arrays * frames * MESH_BYTES
    return Work(frames, f"{frames:,} frames", size, mapped_bytes=size)


def _decode(settings: Settings, material: Material) -> Work:
    # Besides each network's offsets those of the autoencoder itself.
    frames, arrays = frames_of(material.decoded), 1 + len(settings["train"]["predictors"])
    size = arrays * frames * MESH_BYTES
    return Work(frames * arrays, _in_arrays(frames, arrays), size, mapped_bytes=size)


def _evaluate(settings: Settings, material: Material) -> Work:
    frames = frames_of(material.decoded)
    predictors = len(settings["train"]["predictors"]) + ("predict_plus" in settings)
    return Work(frames * predictors, _in_arrays(frames, predictors))


def _report(settings: Settings, material: Material) -> Work:
    own = settings["report"]
    return Work(own["panel_px"] ** 2, f"bodies {own['panel_px']} pixels high")


def _in_arrays(frames: int, arrays: int) -> str:
    return f"{frames:,} frames by {arrays} predictors"


_WORKS: dict[str, Callable[[Settings, Material], Work]] = {
    "truth": _truth,
    "corpus": _corpus,
    "align": _align,
    "align_robust": _align_robust,
    "train-ae": _train_ae,
    "encode": _encode,
    "train": _train,
    "train_plus": _train_plus,
    "predict": _predict,
    "predict_plus": _predict_plus,
    "decode": _decode,
    "evaluate": _evaluate,
    "report": _report,
}
