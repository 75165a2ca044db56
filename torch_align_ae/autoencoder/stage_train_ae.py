"""`dsnet train-ae`: train the mesh autoencoder on the aligned offsets (Sections 4.1 and 5)."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from tyro.conf import Fixed

from bridge.body.containers import load_dmpl_directions
from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.dsnet import (
    AUTOENCODER,
    DMPL,
    LINEAR_FILES,
    LITERAL_CODES,
    PCA,
    CodeName,
    LiteralCodeName,
)
from bridge.motion import sequences_of
from bridge.motion.splits import (
    FrameSplit,
    SplitName,
    held_out_frames,
    split_autoencoder_frames,
)
from bridge.options import NonNegativeInt
from bridge.paper import ALTERNATIVE_WIDTHS, LATENT_SIZE
from bridge.runs import Artifact, ArtifactWriter, Run
from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codes import (
    Codec,
    NormalisationName,
    OffsetCodec,
    PcaCodec,
    fit_normaliser,
    reconstruction_r2,
    weights_file,
)
from torch_align_ae.autoencoder.mesh_autoencoder import (
    SAMPLE_FRAMES,
    MeshAutoencoder,
    initialise_with_modes,
    parameter_count,
)
from torch_align_ae.autoencoder.training import (
    Schedule,
    Training,
    TrainingOptions,
    TrainingPlan,
    keep_freed_memory,
    multiplies_bfloat16,
)
from torch_align_ae.workers import device

PresetName = Literal["literal", "literal_per_coordinate", "measured", "short"]
PrecisionName = Literal["auto", "bfloat16", "float32"]
ComparisonName = Literal["measured", "short", "sequence_split", "all_frames"]


@dataclass(frozen=True)
class TrainingPreset(Schedule):
    """One choice of what the paper leaves open about the training of the autoencoder."""

    normalisation: NormalisationName
    initialisation: Literal["torch", "modes"]  # PyTorch's initial weights, or a linear code
    departures: tuple[str, ...]  # from the paper's words or their plainest meaning


_OF_LINEAR_CODE = (
    "offsets have their mean removed and are divided by one standard deviation, "
    "so that values leave [-1, 1]",
    "the weights begin as a linear code of the leading vertex modes of training frames",
)
_MEASURED = TrainingPreset(
    normalisation="standard",
    initialisation="modes",
    warmup_steps=20,
    cosine_decay=True,
    departures=(
        *_OF_LINEAR_CODE,
        "the learning rate rises over 20 steps to the paper's 1e-4 and falls along a cosine",
    ),
)

PRESETS: dict[PresetName, TrainingPreset] = {
    "literal": TrainingPreset("global_maximum", "torch", departures=()),
    "literal_per_coordinate": TrainingPreset("coordinate_range", "torch", departures=()),
    "measured": _MEASURED,
    # Adam's rate decides how far training first moves away from the linear code, and how close it
    # gets again in few steps, so it is in proportion to the error of that code.
    "short": replace(
        _MEASURED,
        learning_rate_of_loss=0.0134,
        departures=(
            *_OF_LINEAR_CODE,
            "the learning rate is in proportion to the linear code's validation error (1e-3 for "
            "an error of 0.075) instead of 1e-4; it rises over 20 steps and falls along a cosine",
        ),
    ),
}
"""The paper's words taken literally, in two readings of 'within [-1, 1]' (all offsets by one
number, or each coordinate by its own range), and settings that learn well on these data."""


@dataclass(frozen=True)
class TrainAutoencoderConfig(TrainingOptions):
    """Train the mesh autoencoder: about 0.4 s a step of 64 frames on two cores that multiply
    bfloat16, twice that in float32; 1.5 GB of memory.

    Gives `autoencoder.safetensors` (weights and normaliser); `literal.safetensors` and
    `literal_per_coordinate.safetensors`, the same network by the paper's words alone;
    `pca.safetensors`, a linear code of the same size; the losses, and the share of the validation
    offsets' energy that each keeps.
    """

    run: str = "demo"
    """Folder under runs/ that holds the aligned offsets."""
    precision: PrecisionName = "auto"
    """Precision of the matrix products in training; `auto` is `bfloat16` where the processor has
    instructions for it. Weights, their sums and all scores are float32."""
    epochs: NonNegativeInt = 100
    """Passes over the training frames if --steps is 0."""
    patience: Fixed[NonNegativeInt] = 10
    preset: PresetName = "measured"
    """How to read what the paper leaves open: by its plainest words (`literal` and
    `literal_per_coordinate`: [-1, 1] of all offsets, or of each coordinate; float32, all meshes),
    by what was measured to learn (`measured`), or by what learns in a few hundred steps (`short`).
    """
    literal_steps: NonNegativeInt = 100
    """Steps of the two `literal` trainings that every other preset has beside it, as codes of
    their own; 0: none."""
    split: Fixed[SplitName] = "frame"
    """70 % of the frames, as in the paper, or 70 % of the sequences, which does not leak."""
    include_held_out: Fixed[bool] = False
    """Draw from the validation sequences too, as the paper does: its code has seen the clip on
    which DSNet is judged."""
    comparisons: tuple[ComparisonName, ...] = ()
    """Further trainings, for the report alone: another preset, a split by sequences, or all frames,
    those of the held-out sequences too."""
    dmpl: Path | None = None
    """DMPL's `model.npz`, with licensed meshes only: its 8 directions become a code too, on which
    a predictor of a plug-in can be trained."""


PROFILES: dict[str, TrainAutoencoderConfig] = {
    "smoke": TrainAutoencoderConfig(
        run="smoke", steps=10, patience=0, validation_frames=128, literal_steps=2
    ),
    "demo": TrainAutoencoderConfig(
        run="demo",
        preset="short",
        steps=175,
        validate_every=35,
        patience=0,
        validation_frames=256,
    ),
    # The paper states no length; what fits into three hours of two cores (docs/paper.md).
    "paper": TrainAutoencoderConfig(
        run="paper",
        include_held_out=True,
        epochs=25,
        validation_frames=1024,
        literal_steps=1180,
    ),
}


def main(config: TrainAutoencoderConfig) -> None:
    run = Run(config.run)
    align = run.artifact("align")
    upstream: dict[str, Artifact | Path] = {"align": align}
    if config.dmpl:
        if align.origin == "synthetic":
            raise DsnetError(
                f"--dmpl {config.dmpl} beside synthetic meshes",
                "meshes of SMPL's topology: vertices of the embedded bodies have another order",
                "Leave --dmpl out, or align licensed files (docs/data.md).",
            )
        load_dmpl_directions(config.dmpl)  # refuses a bad file before hours of training
        upstream["dmpl"] = config.dmpl
    keep_freed_memory()
    make = partial(_make, config, align)
    run.build("train-ae", config, make, data=align.origin, upstream=upstream)


def _make(config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter) -> None:
    beside: tuple[LiteralCodeName, ...] = LITERAL_CODES if config.literal_steps else ()
    if config.preset == "literal" or config.preset == "literal_per_coordinate":
        config, beside = _literal(config, config.preset), ()
    split = _make_code(AUTOENCODER, config, align, writer)
    writer.record(parameters=parameter_counts())
    for code in beside:
        _make_code(code, _literal(config, code, steps=config.literal_steps), align, writer)
    # Linear codes, fitted to the frames on which the autoencoder is trained.
    offsets_m = align.array("offsets")
    linear: dict[CodeName, PcaCodec]
    linear = {PCA: PcaCodec.fit(offsets_m, split.train, LATENT_SIZE, seed=config.seed)}
    if config.dmpl:
        linear[DMPL] = PcaCodec.of_directions(load_dmpl_directions(config.dmpl))
    for code, fitted in linear.items():
        save_weights(writer.file_path(LINEAR_FILES[code]), vars(fitted))
        scores = _scores(fitted, align, offsets_m, split)
        writer.record(**{code: {"components": len(fitted.components), **scores}})
    compared = []
    for name in config.comparisons:
        other = _comparison(config, name)
        compared.append(_trained(name, other, align, writer)[-1])
    writer.record(comparisons=compared)


def _make_code(
    code: CodeName, config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter
) -> FrameSplit:
    """Train an autoencoder whose latents the run uses; gives its frames."""
    codec, split, summary = _trained(code, config, align, writer)
    codec.save(writer.file_path(weights_file(code)))
    writer.record(**{code: summary}, architecture=codec.architecture())
    return split


def _literal(
    config: TrainAutoencoderConfig, preset: LiteralCodeName, **changes: Any
) -> TrainAutoencoderConfig:
    """A training by the paper's words alone: Adam at 1e-4 in float32, on 70 % of all meshes."""
    if config.precision == "auto":
        changes["precision"] = "float32"
    return replace(
        config, preset=preset, split="frame", include_held_out=True, patience=0, **changes
    )


def _comparison(config: TrainAutoencoderConfig, name: ComparisonName) -> TrainAutoencoderConfig:
    if name == "sequence_split":
        return replace(config, split="sequence")
    if name == "all_frames":
        return replace(config, include_held_out=True)
    return replace(config, preset=name)


def _departures(config: TrainAutoencoderConfig) -> list[str]:
    """All that a training does otherwise than the paper says."""
    departures = [*PRESETS[config.preset].departures]
    if config.precision == "bfloat16":
        departures.append("training steps multiply bfloat16 matrices")
    if config.split == "sequence":
        departures.append("70 % of the sequences are trained on in place of 70 % of the frames")
    if not config.include_held_out:
        departures.append("meshes of the held-out sequences are in neither share")
    return departures


def _begun(
    name: str, config: TrainAutoencoderConfig, checkpoint: Path, align: Artifact
) -> Training[MeshAutoencoder]:
    """A training before its first step."""
    preset = PRESETS[config.preset]
    offsets_m = align.array("offsets")  # opened once, as pages of two memory maps would count twice
    split = split_autoencoder_frames(
        sequences_of(align), config.seed, by=config.split, include_held_out=config.include_held_out
    )
    normaliser = fit_normaliser(preset.normalisation, offsets_m, split.train)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model = MeshAutoencoder()
    if preset.initialisation == "modes":
        sample = torch.from_numpy(mode_sample(offsets_m, split, config.seed))
        initialise_with_modes(model, normaliser.normalise(sample), config.seed)
    model.to(device())
    settings = {one.name: getattr(config, one.name) for one in fields(TrainingOptions)}
    settings |= {one.name: getattr(preset, one.name) for one in fields(Schedule)}
    per_epoch = math.ceil(len(split.train) / config.batch_size)
    settings["steps"] = config.steps or config.epochs * per_epoch
    plan = TrainingPlan(**settings, bfloat16=config.precision == "bfloat16")
    label = f"train-ae {name}"
    return Training(model, normaliser, offsets_m, split, plan, checkpoint, label)


def _trained(
    name: str, config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter
) -> tuple[Codec, FrameSplit, dict[str, Any]]:
    """Train, or continue from the checkpoint; gives codec, frames and entry of the manifest."""
    checkpoint = writer.checkpoints.resolve() / f"{name}.safetensors"
    if config.precision == "auto":
        fast = multiplies_bfloat16() and device().type == "cpu"
        config = replace(config, precision="bfloat16" if fast else "float32")
    training = _begun(name, config, checkpoint, align)
    codec = Codec(training.model, training.normaliser)
    offsets_m, split = training.offsets_m, training.split
    initial_r2 = reconstruction_r2(codec, offsets_m, split.validation)
    started = time.perf_counter()
    result = training.run()
    writer.record_measured(**{f"{name}_training_s": round(time.perf_counter() - started, 2)})
    suffix = "" if name == AUTOENCODER else f"_{name}"
    writer.put(f"loss{suffix}", result.losses.astype(np.float32), "1")
    writer.put(f"validation_loss{suffix}", result.validation_losses.astype(np.float32), "1")
    writer.put(f"validation_steps{suffix}", result.steps.astype(np.int32), "step")
    codec.cpu().eval()
    summary = {
        "name": name,
        "preset": config.preset,
        **asdict(PRESETS[config.preset]),
        "departures": _departures(config),
        "loss": "mean squared error of normalised offsets",
        "precision": config.precision,
        "split": config.split,
        "train_frames": len(split.train),
        "validation_frames": len(split.validation),
        "steps": training.plan.steps,
        "learning_rate": float(training.learning_rate),
        "steps_taken": int(result.steps[-1]),
        "best_step": int(result.steps[result.best]),
        "r2_initial": initial_r2,
        "include_held_out": config.include_held_out,
        **_scores(codec, align, offsets_m, split),
    }
    return codec, split, summary


def mode_sample(
    offsets_m: NDArray[np.float32], split: FrameSplit, seed: int
) -> NDArray[np.float32]:
    """The sample (frames, V, 3) of training frames for `initialise_with_modes`, metres."""
    count = min(SAMPLE_FRAMES, len(split.train))
    frames = np.random.default_rng(seed).choice(split.train, count, replace=False)
    return np.asarray(offsets_m[np.sort(frames)], dtype=np.float32)


def _scores(
    codec: OffsetCodec, align: Artifact, offsets_m: NDArray[np.float32], split: FrameSplit
) -> dict[str, float | None]:
    """R2 on validation frames, and on held-out sequences; None if there are none."""
    held_out = held_out_frames(sequences_of(align))
    return {
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
        "r2_held_out": reconstruction_r2(codec, offsets_m, held_out) if len(held_out) else None,
    }


def parameter_counts() -> dict[str, int]:
    """Trainable parameters (Section 5), counted without allocating them."""
    with torch.device("meta"):
        models = {
            "mesh_autoencoder": MeshAutoencoder(),
            "mesh_autoencoder_alternative": MeshAutoencoder(ALTERNATIVE_WIDTHS),
            "casas_otaduy": CasasOtaduyAutoencoder(),
        }
    return {name: parameter_count(model) for name, model in models.items()}
