"""`dsnet train-ae`: train the mesh autoencoder on the aligned offsets (Sections 4.1 and 5)."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from bridge.motion import sequences_of
from bridge.motion.splits import FrameSplit, SplitName, split_frames, split_sequences
from bridge.paper import ALTERNATIVE_WIDTHS, INFERRED_WIDTHS, LATENT_SIZE
from bridge.runs import Artifact, ArtifactWriter, Run
from torch_align_ae.autoencoder.allocation import keep_freed_memory
from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codec import WEIGHTS_FILE, Codec
from torch_align_ae.autoencoder.initialisation import SAMPLE_FRAMES, initialise_with_modes
from torch_align_ae.autoencoder.mesh_autoencoder import (
    MeshAutoencoder,
    parameter_count,
)
from torch_align_ae.autoencoder.normaliser import Normaliser, fit_normaliser
from torch_align_ae.autoencoder.pca import PcaCodec
from torch_align_ae.autoencoder.presets import PRESETS, PresetName, TrainingPreset
from torch_align_ae.autoencoder.scoring import reconstruction_r2
from torch_align_ae.autoencoder.training import Training, TrainingPlan, TrainingResult

TrialName = Literal["literal", "measured", "sequence_split"]


@dataclass(frozen=True)
class TrainAutoencoderConfig:
    """Train the mesh autoencoder: about 0.9 s a step of 64 frames on two cores, 1.5 GB of memory.

    Gives `autoencoder.safetensors` (weights and normaliser), the losses, and the share of the
    validation offsets' energy that it keeps, beside PCA with as many components.
    """

    run: str = "demo"
    """Folder under runs/ that holds the aligned offsets."""
    seed: int = 0
    """Decides the split, the weights' beginning and the order of frames."""
    reading: PresetName = "measured"
    """How the paper's silences are filled: its plainest words, or what was measured to learn."""
    split: SplitName = "frame"
    """70 % of the frames, as in the paper, or 70 % of the sequences, which does not leak."""
    comparisons: tuple[TrialName, ...] = ()
    """Further trainings, only reported: the other reading, or the sequence-level split."""
    architecture: Literal["inferred", "alternative"] = "inferred"
    """Widths 2000-1300-300-30, or 2000-1250-400-20: the same number of parameters."""
    batch_size: int = 64
    """Frames a step; the paper's is 64."""
    steps: int = 0
    """Optimiser steps; 0: as many as `epochs` make."""
    epochs: int = 100
    """Passes over the training frames when `steps` is 0."""
    patience: int = 10
    """Epochs without a better validation loss after which training stops; 0: never."""
    validation_frames: int = 0
    """Validation frames scored after each epoch; 0: all. The final score always takes all."""


PROFILES: dict[str, TrainAutoencoderConfig] = {
    "smoke": TrainAutoencoderConfig(run="smoke", steps=10, patience=0, validation_frames=128),
    "demo": TrainAutoencoderConfig(run="demo", steps=70, patience=0, validation_frames=512),
    "paper": TrainAutoencoderConfig(
        run="paper", reading="measured", comparisons=("literal", "sequence_split")
    ),
}


@dataclass(frozen=True)
class Trial:
    """One training of the stage: a reading and a split."""

    name: str
    reading: PresetName
    split: SplitName


def main(config: TrainAutoencoderConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued."""
    align = Run(config.run).artifact("align")
    keep_freed_memory()
    Run(config.run).build(
        "train-ae",
        config,
        lambda writer: _make(config, align, writer),
        data=align.origin,
        upstream={"align": align},
    )


def _make(config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter) -> None:
    main_trial = Trial("autoencoder", config.reading, config.split)
    codec, result, summary = _run_trial(config, main_trial, align, writer)
    codec.save(writer.file_path(WEIGHTS_FILE))
    writer.put("loss", result.history.astype(np.float32), "1 (columns: training, validation)")
    writer.record(
        architecture=codec.architecture(),
        autoencoder=summary,
        pca=_pca_baseline(config, align),
        parameters=parameter_counts(),
    )
    del codec
    compared = []
    for name in config.comparisons:
        _codec, result, summary = _run_trial(config, _comparison(config, name), align, writer)
        writer.put(f"loss_{name}", result.history.astype(np.float32), "1")
        compared.append(summary)
    writer.record(comparisons=compared)


def _comparison(config: TrainAutoencoderConfig, name: TrialName) -> Trial:
    if name == "sequence_split":
        return Trial(name, config.reading, "sequence")
    return Trial(name, name, config.split)


def _run_trial(
    config: TrainAutoencoderConfig, trial: Trial, align: Artifact, writer: ArtifactWriter
) -> tuple[Codec, TrainingResult, dict[str, Any]]:
    offsets_m, reading = align.array("offsets"), PRESETS[trial.reading]
    split = _split(config, trial, align)
    normaliser = fit_normaliser(reading.normalisation, offsets_m, split.train)
    model = _new_model(config, reading, normaliser, offsets_m, split)
    codec = Codec(model, normaliser)
    initial_r2 = reconstruction_r2(codec, offsets_m, split.validation)
    training = Training(
        model.to("cuda" if torch.cuda.is_available() else "cpu"),
        normaliser,
        offsets_m,
        split,
        plan_of(config, reading, len(split.train)),
        writer.checkpoints / f"{trial.name}.safetensors",
        label=f"train-ae {trial.name}",
    )
    started = time.perf_counter()
    result = training.run()
    writer.record_measured(**{f"{trial.name}_training_s": round(time.perf_counter() - started, 2)})
    model.cpu().eval()
    summary = {
        "name": trial.name,
        "reading": trial.reading,
        **asdict(reading),
        "loss": "mean squared error of normalised offsets",
        "split": trial.split,
        "train_frames": len(split.train),
        "validation_frames": len(split.validation),
        "steps": training.plan.steps,
        "epochs": len(result.history) - 1,
        "best_epoch": result.best_epoch,
        "r2_initial": initial_r2,
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
    }
    return codec, result, summary


def plan_of(
    config: TrainAutoencoderConfig, reading: TrainingPreset, train_frames: int
) -> TrainingPlan:
    """The plan of one reading under the stage's budget."""
    per_epoch = math.ceil(train_frames / config.batch_size)
    return TrainingPlan(
        steps=config.steps or config.epochs * per_epoch,
        batch_size=config.batch_size,
        learning_rate=reading.learning_rate,
        warmup_steps=reading.warmup_steps,
        cosine_decay=reading.cosine_decay,
        patience=config.patience,
        validation_frames=config.validation_frames,
        seed=config.seed,
    )


def _split(config: TrainAutoencoderConfig, trial: Trial, align: Artifact) -> FrameSplit:
    if trial.split == "sequence":
        return split_sequences(sequences_of(align), config.seed)
    return split_frames(align.manifest["arrays"]["offsets"]["shape"][0], config.seed)


def _new_model(
    config: TrainAutoencoderConfig,
    reading: TrainingPreset,
    normaliser: Normaliser,
    offsets_m: NDArray[np.float32],
    split: FrameSplit,
) -> MeshAutoencoder:
    widths = INFERRED_WIDTHS if config.architecture == "inferred" else ALTERNATIVE_WIDTHS
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = MeshAutoencoder(widths, reading.activation, reading.negative_slope)
    if reading.initialisation == "modes":
        count = min(SAMPLE_FRAMES, len(split.train))
        frames = np.random.default_rng(config.seed).choice(split.train, count, replace=False)
        sample = torch.from_numpy(np.asarray(offsets_m[np.sort(frames)], dtype=np.float32))
        initialise_with_modes(model, normaliser.normalise(sample), config.seed)
    return model


def _pca_baseline(config: TrainAutoencoderConfig, align: Artifact) -> dict[str, Any]:
    offsets_m = align.array("offsets")
    split = _split(config, Trial("pca", config.reading, config.split), align)
    codec = PcaCodec.fit(offsets_m, split.train, LATENT_SIZE, seed=config.seed)
    return {
        "components": len(codec.components),
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
    }


def parameter_counts() -> dict[str, int]:
    """Trainable parameters of the built models (Section 5), without allocating them."""
    with torch.device("meta"):
        return {
            "mesh_autoencoder": parameter_count(MeshAutoencoder()),
            "mesh_autoencoder_alternative": parameter_count(MeshAutoencoder(ALTERNATIVE_WIDTHS)),
            "casas_otaduy": parameter_count(CasasOtaduyAutoencoder()),
        }
