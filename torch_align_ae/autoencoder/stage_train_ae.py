"""`dsnet train-ae`: train the mesh autoencoder on the aligned offsets (Sections 4.1 and 5)."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from bridge.body.dmpl_files import load_dmpl_directions
from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.codes import DMPL, LINEAR_FILES, PCA, CodeName
from bridge.motion import sequences_of
from bridge.motion.splits import (
    FrameSplit,
    SplitName,
    held_out_frames,
    split_autoencoder_frames,
)
from bridge.options import NonNegativeInt, PositiveInt, Seed
from bridge.paper import ALTERNATIVE_WIDTHS, INFERRED_WIDTHS, LATENT_SIZE
from bridge.runs import Artifact, ArtifactWriter, Run
from torch_align_ae.autoencoder.allocation import keep_freed_memory
from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codec import WEIGHTS_FILE, Codec
from torch_align_ae.autoencoder.initialisation import SAMPLE_FRAMES, initialise_with_modes
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder, parameter_count
from torch_align_ae.autoencoder.normaliser import Normaliser, fit_normaliser
from torch_align_ae.autoencoder.pca import PcaCodec, reconstruction_r2
from torch_align_ae.autoencoder.presets import PRESETS, PresetName, TrainingPreset
from torch_align_ae.autoencoder.training import Training, TrainingPlan, TrainingResult
from torch_align_ae.processes import Processes, started_by_torchrun

TrialName = Literal["literal", "measured", "short", "sequence_split", "all_frames"]


@dataclass(frozen=True)
class TrainAutoencoderConfig:
    """Train the mesh autoencoder: about 0.9 s a step of 64 frames on two cores, 1.5 GB of memory.

    Several processes, on several machines that see the same runs, share each batch when torchrun
    starts them: `torchrun --nproc-per-node 2 --no-python dsnet train-ae --run RUN`.

    Gives `autoencoder.safetensors` (weights and normaliser), `pca.safetensors`, the linear code of
    the same frames and size, the losses, and the share of the
    validation offsets' energy that both keep.
    """

    run: str = "demo"
    """Folder under runs/ that holds the aligned offsets."""
    seed: Seed = 0
    """Decides the split, the weights' beginning and the order of frames."""
    preset: PresetName = "measured"
    """How the paper's silences are filled: by its plainest words (`literal`), by what was measured
    to learn, or by what learns in a few hundred steps (`short`)."""
    split: SplitName = "frame"
    """70 % of the frames, as in the paper, or 70 % of the sequences, which does not leak."""
    include_held_out: bool = False
    """Draw from the validation sequences too, as the paper does: its code has seen the clip on
    which DSNet is judged."""
    comparisons: tuple[TrialName, ...] = ()
    """Further trainings, only reported: another preset, the sequence-level split, or all frames,
    those of the held-out sequences too."""
    architecture: Literal["inferred", "alternative"] = "inferred"
    """Widths 2000-1300-300-30, or 2000-1250-400-20: the same number of parameters."""
    batch_size: PositiveInt = 64
    """Frames a step; the paper's is 64."""
    steps: NonNegativeInt = 0
    """Optimiser steps; 0: as many as `epochs` make."""
    epochs: NonNegativeInt = 100
    """Passes over the training frames when `steps` is 0."""
    stop_epoch: NonNegativeInt = 0
    """Epoch after which the training, not `comparisons`, ends with the learning rate that it has on
    the way to `epochs`: what a long run is so far, to the bit; 0: never."""
    comparison_epochs: NonNegativeInt = 0
    """Passes of each of `comparisons`; 0: as long as the training itself."""
    validate_every: NonNegativeInt = 0
    """Steps between two validation losses, the best of which decides what is kept; 0: an epoch."""
    patience: NonNegativeInt = 10
    """Validation losses without a better one after which training stops; 0: never."""
    validation_frames: NonNegativeInt = 0
    """Validation frames scored each time; 0: all. The final score always takes all."""
    dmpl: Path | None = None
    """DMPL's `model.npz`, beside licensed meshes: its 8 directions become a third code, on which
    predictor `dyna_like_dmpl` can be trained."""


PROFILES: dict[str, TrainAutoencoderConfig] = {
    "smoke": TrainAutoencoderConfig(run="smoke", steps=10, patience=0, validation_frames=128),
    "demo": TrainAutoencoderConfig(
        run="demo",
        preset="short",
        steps=175,
        validate_every=35,
        patience=0,
        validation_frames=256,
    ),
    # The paper states no length; these fit into eight hours of two cores (docs/paper.md).
    "paper": TrainAutoencoderConfig(
        run="paper", include_held_out=True, comparisons=("literal",), comparison_epochs=20
    ),
}


@dataclass(frozen=True)
class Trial:
    """One training of the stage: a preset and a split."""

    name: str
    preset: PresetName
    split: SplitName
    include_held_out: bool


@dataclass(frozen=True)
class _NextTraining:
    """What the leader of several processes is about to train."""

    config: TrainAutoencoderConfig
    trial: Trial
    checkpoint: Path


def main(config: TrainAutoencoderConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued."""
    align = Run(config.run).artifact("align")
    if config.dmpl:
        _check_dmpl(config.dmpl, align)
    keep_freed_memory()
    with started_by_torchrun() as processes:
        if not processes.leads:
            _follow(align, processes)
            return
        Run(config.run).build(
            "train-ae",
            config,
            lambda writer: _make(config, align, writer, processes),
            data=align.origin,
            upstream={"align": align} | ({"dmpl": config.dmpl} if config.dmpl else {}),
        )
        processes.told(None)


def _check_dmpl(path: Path, align: Artifact) -> None:
    """Before hours of training."""
    if align.origin == "synthetic":
        raise DsnetError(
            f"--dmpl {path} beside synthetic meshes",
            "meshes of SMPL's topology: vertices of the embedded bodies have another order",
            "Leave --dmpl out, or align licensed files (docs/data.md).",
        )
    load_dmpl_directions(path)


def _follow(align: Artifact, processes: Processes) -> None:
    """Share the leader's work until it says that there is no more."""
    nothing: _NextTraining | None = None
    while job := processes.told(nothing):
        _training(job, _beginning(job, align), processes).run()


def _make(
    config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter, processes: Processes
) -> None:
    codec, result, summary = _run_trial(config, _main_trial(config), align, writer, processes)
    codec.save(writer.file_path(WEIGHTS_FILE))
    _put_losses(writer, "", result)
    linear = _fitted_pca(config, align)
    writer.record(
        architecture=codec.architecture(),
        autoencoder=summary,
        pca=_stored(PCA, linear, config, align, writer),
        parameters=parameter_counts(),
    )
    if config.dmpl:
        given = PcaCodec.of_directions(load_dmpl_directions(config.dmpl))
        writer.record(dmpl=_stored(DMPL, given, config, align, writer))
    del codec
    compared, length = [], _length_of_comparisons(config)
    for name in config.comparisons:
        trial = _comparison(config, name)
        _codec, result, summary = _run_trial(length, trial, align, writer, processes)
        _put_losses(writer, f"_{name}", result)
        compared.append(summary)
    writer.record(comparisons=compared)


def _put_losses(writer: ArtifactWriter, suffix: str, result: TrainingResult) -> None:
    writer.put(f"loss{suffix}", result.losses.astype(np.float32), "1")
    writer.put(f"validation_loss{suffix}", result.validation_losses.astype(np.float32), "1")
    writer.put(f"validation_steps{suffix}", result.steps.astype(np.int32), "step")


def _main_trial(config: TrainAutoencoderConfig) -> Trial:
    return Trial("autoencoder", config.preset, config.split, config.include_held_out)


def _length_of_comparisons(config: TrainAutoencoderConfig) -> TrainAutoencoderConfig:
    """The configuration with the comparisons' number of steps."""
    epochs = config.comparison_epochs
    whole = replace(config, stop_epoch=0)
    return replace(whole, steps=0, epochs=epochs) if epochs else whole


def _comparison(config: TrainAutoencoderConfig, name: TrialName) -> Trial:
    if name == "sequence_split":
        return Trial(name, config.preset, "sequence", config.include_held_out)
    if name == "all_frames":
        return Trial(name, config.preset, config.split, include_held_out=True)
    return Trial(name, name, config.split, config.include_held_out)


@dataclass(frozen=True)
class _Beginning:
    """A network before its first step, and what it will see."""

    codec: Codec
    offsets_m: NDArray[np.float32]
    split: FrameSplit


def _beginning(job: _NextTraining, align: Artifact) -> _Beginning:
    config, trial = job.config, job.trial
    offsets_m, preset = align.array("offsets"), PRESETS[trial.preset]
    split = _split(config, trial, align)
    normaliser = fit_normaliser(preset.normalisation, offsets_m, split.train)
    model = _new_model(config, preset, normaliser, offsets_m, split)
    return _Beginning(Codec(model, normaliser), offsets_m, split)


def _training(
    job: _NextTraining, beginning: _Beginning, processes: Processes
) -> Training[MeshAutoencoder]:
    trial, split = job.trial, beginning.split
    return Training(
        beginning.codec.model.to("cuda" if torch.cuda.is_available() else "cpu"),
        beginning.codec.normaliser,
        beginning.offsets_m,
        split,
        plan_of(job.config, PRESETS[trial.preset], len(split.train)),
        job.checkpoint,
        label=f"train-ae {trial.name}",
        processes=processes,
    )


def _run_trial(
    config: TrainAutoencoderConfig,
    trial: Trial,
    align: Artifact,
    writer: ArtifactWriter,
    processes: Processes,
) -> tuple[Codec, TrainingResult, dict[str, Any]]:
    checkpoint = writer.checkpoints.resolve() / f"{trial.name}.safetensors"
    job = processes.told(_NextTraining(config, trial, checkpoint))
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
        "r2_held_out": _r2_held_out(codec, align),
    }
    return codec, result, summary


def plan_of(
    config: TrainAutoencoderConfig, preset: TrainingPreset, train_frames: int
) -> TrainingPlan:
    """The plan of one preset under the stage's budget."""
    per_epoch = math.ceil(train_frames / config.batch_size)
    return TrainingPlan(
        steps=config.steps or config.epochs * per_epoch,
        stop=config.stop_epoch * per_epoch,
        batch_size=config.batch_size,
        learning_rate=preset.learning_rate,
        learning_rate_of_loss=preset.learning_rate_of_loss,
        warmup_steps=preset.warmup_steps,
        cosine_decay=preset.cosine_decay,
        validate_every=config.validate_every,
        patience=config.patience,
        validation_frames=config.validation_frames,
        seed=config.seed,
    )


def _split(config: TrainAutoencoderConfig, trial: Trial, align: Artifact) -> FrameSplit:
    return split_autoencoder_frames(
        sequences_of(align), config.seed, by=trial.split, include_held_out=trial.include_held_out
    )


def _new_model(
    config: TrainAutoencoderConfig,
    preset: TrainingPreset,
    normaliser: Normaliser,
    offsets_m: NDArray[np.float32],
    split: FrameSplit,
) -> MeshAutoencoder:
    widths = INFERRED_WIDTHS if config.architecture == "inferred" else ALTERNATIVE_WIDTHS
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = MeshAutoencoder(widths, preset.activation, preset.negative_slope)
    if preset.initialisation == "modes":
        count = min(SAMPLE_FRAMES, len(split.train))
        frames = np.random.default_rng(config.seed).choice(split.train, count, replace=False)
        sample = torch.from_numpy(np.asarray(offsets_m[np.sort(frames)], dtype=np.float32))
        initialise_with_modes(model, normaliser.normalise(sample), config.seed)
    return model


def _fitted_pca(config: TrainAutoencoderConfig, align: Artifact) -> PcaCodec:
    """Of the frames that the autoencoder is trained on."""
    frames = _split(config, _main_trial(config), align).train
    return PcaCodec.fit(align.array("offsets"), frames, LATENT_SIZE, seed=config.seed)


def _stored(
    code: CodeName,
    codec: PcaCodec,
    config: TrainAutoencoderConfig,
    align: Artifact,
    writer: ArtifactWriter,
) -> dict[str, Any]:
    """Write a linear code's file; returns what it keeps of the offsets."""
    save_weights(writer.file_path(LINEAR_FILES[code]), codec.arrays())
    offsets_m = align.array("offsets")
    split = _split(config, _main_trial(config), align)
    return {
        "components": len(codec.components),
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
        "r2_held_out": _r2_held_out(codec, align),
    }


def _r2_held_out(codec: Codec | PcaCodec, align: Artifact) -> float | None:
    """R2 on the sequences that are held out; None if there are none."""
    frames = held_out_frames(sequences_of(align))
    return reconstruction_r2(codec, align.array("offsets"), frames) if len(frames) else None


def parameter_counts() -> dict[str, int]:
    """Trainable parameters of the built models (Section 5), without allocating them."""
    with torch.device("meta"):
        return {
            "mesh_autoencoder": parameter_count(MeshAutoencoder()),
            "mesh_autoencoder_alternative": parameter_count(MeshAutoencoder(ALTERNATIVE_WIDTHS)),
            "casas_otaduy": parameter_count(CasasOtaduyAutoencoder()),
        }
