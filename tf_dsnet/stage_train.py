"""Stage `train`: DSNet learns latents from motions (Section 5, "Training process")."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from tqdm import tqdm

from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.dsnet_presets import PRESETS, PresetName, Scaling
from bridge.motion.clips import UnpaddedClip, fit_scaling, load_unpadded_clips, make_clips
from bridge.runs import ArtifactWriter, Run
from tf_dsnet.course import Course
from tf_dsnet.model import named_weights, parameter_counts
from tf_dsnet.trainer import Trainer

STAGE = "train"


@dataclass(frozen=True)
class TrainConfig:
    """Train DSNet on the training sequences, once for each reading of the paper.

    Costs a quarter of a second an epoch of both for 40 sequences of 300 frames on two cores, 1 GB.
    Gives weights and losses of every reading. The weights of the last epoch are kept: choosing
    the epoch that suits the validation sequence best would make its error a training error.
    """

    run: str = "demo"
    """Name of the run whose latents are learned."""
    seed: int = 0
    """Seed of the initial weights and of the order of the clips."""
    readings: tuple[PresetName, ...] = PRESETS
    """Which readings to train; the first is the one that `predict` uses. `faithful`: raw inputs
    and latents. `standardised`: both scaled, a departure from the paper, which is silent."""
    epochs: int = 500
    """Epochs of each reading (the paper does not say how many)."""
    frames: int = 300
    """Length to which sequences are padded or clipped (paper: 300)."""
    batch_size: int = 16
    """Sequences in a batch (paper: 16)."""
    lr_faithful: float = 1e-4
    """Adam's learning rate for `faithful` (paper: 0.0001)."""
    lr_standardised: float = 1e-3
    """Adam's learning rate for `standardised`; a departure where it is not 0.0001."""
    masked: bool = False
    """Leave padded frames out of the loss and of the batch normalisation (the paper does not)."""
    min_input_std: float = 0.05
    """Least spread (rad, m or 1) by which `standardised` divides an input."""
    validate_every: int = 10
    """Epochs between two validation losses."""
    checkpoint_every: int = 100
    """Epochs between two checkpoints."""

    def lr(self, reading: PresetName) -> float:
        """Learning rate of one reading."""
        return self.lr_faithful if reading == "faithful" else self.lr_standardised


PROFILES: dict[str, TrainConfig] = {
    "smoke": TrainConfig(run="smoke", epochs=20),
    "demo": TrainConfig(run="demo"),
    "paper": TrainConfig(run="paper", epochs=20_000, checkpoint_every=500),
}


def main(config: TrainConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued.

    Raises
    ------
    DsnetError
        If the run has no finished `encode`, or a setting makes no sense.
    """
    _check(config)
    run = Run(config.run)
    encoded = run.artifact("encode")

    def make(writer: ArtifactWriter) -> None:
        recordings = load_unpadded_clips(encoded, "train")
        held_out = load_unpadded_clips(encoded, "validation")
        fitted = fit_scaling(recordings, config.min_input_std)
        courses: dict[PresetName, Course] = {
            reading: _course(reading, config, fitted, recordings, held_out, writer)
            for reading in config.readings
        }
        _train(courses, config)
        for reading, course in courses.items():
            _store(reading, course, writer)
        _describe(config, fitted, len(recordings), len(held_out), writer)

    run.build(STAGE, config, make, data=encoded.origin, upstream={"encode": encoded})


def _check(config: TrainConfig) -> None:
    if not config.readings or len(set(config.readings)) < len(config.readings):
        raise DsnetError(
            f"readings {config.readings}", "each one once", "Pass --readings standardised faithful."
        )
    for name in ("epochs", "frames", "batch_size", "validate_every", "checkpoint_every"):
        if getattr(config, name) < 1:
            flag = f"--{name.replace('_', '-')}"
            raise DsnetError(f"{flag} {getattr(config, name)}", "1 or more", f"Pass {flag} N.")


def _course(
    reading: PresetName,
    config: TrainConfig,
    fitted: Scaling,
    recordings: list[UnpaddedClip],
    held_out: list[UnpaddedClip],
    writer: ArtifactWriter,
) -> Course:
    scaling = Scaling.identity() if reading == "faithful" else fitted
    train, validation = (
        make_clips(part, scaling, config.frames) for part in (recordings, held_out)
    )
    trainer = Trainer(
        train,
        lr=config.lr(reading),
        batch_size=config.batch_size,
        masked=config.masked,
        seed=config.seed,
    )
    trainer.trace()
    return Course(trainer, validation, writer.checkpoints / f"{reading}.safetensors")


def _train(courses: Mapping[PresetName, Course], config: TrainConfig) -> None:
    """Readings side by side, epoch by epoch: one alone leaves half of two cores idle."""
    first = min(len(course.losses) for course in courses.values())
    # disable=None: quiet when the output is not a terminal.
    epochs = tqdm(
        range(first, config.epochs),
        desc=" and ".join(courses),
        total=config.epochs,
        initial=first,
        unit="epoch",
        disable=None,
        mininterval=0.5,
    )
    with ThreadPoolExecutor(len(courses)) as pool:
        for epoch in epochs:
            validate = _due(epoch, config.validate_every, config.epochs)
            advance = partial(Course.epoch, number=epoch, validate=validate)
            list(pool.map(advance, courses.values()))  # raises what a thread raised
            if validate:
                epochs.set_postfix({n: c.validation_losses[-1] for n, c in courses.items()})
            if _due(epoch, config.checkpoint_every, config.epochs):
                for course in courses.values():
                    course.save()


def _due(epoch: int, every: int, epochs: int) -> bool:
    """Whether something done every so many epochs, and at the end, is due after this epoch."""
    return (epoch + 1) % every == 0 or epoch + 1 == epochs


def _store(reading: PresetName, course: Course, writer: ArtifactWriter) -> None:
    if course.epoch_s is not None:
        writer.record_measured(**{f"epoch_s_{reading}": round(course.epoch_s, 4)})
    model = course.trainer.model
    save_weights(writer.file_path(f"{reading}.safetensors"), named_weights(model))
    unit = "latent unit, summed over frames"
    writer.put(f"loss_{reading}", np.array(course.losses, np.float32), unit)
    validation = np.array(course.validation_losses, np.float32)
    writer.put(f"validation_loss_{reading}", validation, unit)
    writer.record(parameters=parameter_counts(model))


def _describe(
    config: TrainConfig, fitted: Scaling, trained_on: int, held_out: int, writer: ArtifactWriter
) -> None:
    writer.put("input_mean", fitted.input_mean, "1, rad, m")
    writer.put("input_std", fitted.input_std, "1, rad, m")
    writer.put("latent_mean", fitted.latent_mean, "latent unit")
    writer.put("latent_std", fitted.latent_std, "latent unit")
    epochs = [e + 1 for e in range(config.epochs) if _due(e, config.validate_every, config.epochs)]
    writer.put("validation_epochs", np.array(epochs, np.int32), "epoch")
    writer.record(
        reading=config.readings[0],
        readings={
            name: {
                "lr": config.lr(name),
                "standardised": name == "standardised",
                "departs_from_paper": name == "standardised",
            }
            for name in config.readings
        },
        sequences_trained_on=trained_on,
        sequences_held_out=held_out,
    )
