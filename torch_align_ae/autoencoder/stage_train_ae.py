"""`dsnet train-ae`: train the mesh autoencoder on the aligned offsets (Sections 4.1 and 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from tyro.conf import Fixed

from bridge.body.smpl_files import load_dmpl_directions
from bridge.errors import DsnetError
from bridge.exchange import save_weights
from bridge.exchange.codes import DMPL, LINEAR_FILES, PCA, CodeName
from bridge.motion.splits import SplitName
from bridge.options import NonNegativeInt
from bridge.paper import ALTERNATIVE_WIDTHS, LATENT_SIZE
from bridge.runs import Artifact, ArtifactWriter, Run
from torch_align_ae.autoencoder.allocation import keep_freed_memory
from torch_align_ae.autoencoder.casas_otaduy import CasasOtaduyAutoencoder
from torch_align_ae.autoencoder.codec import WEIGHTS_FILE
from torch_align_ae.autoencoder.mesh_autoencoder import MeshAutoencoder, parameter_count
from torch_align_ae.autoencoder.pca import PcaCodec, reconstruction_r2
from torch_align_ae.autoencoder.presets import PresetName
from torch_align_ae.autoencoder.training import TrainingResult
from torch_align_ae.autoencoder.trials import (
    Trial,
    TrialOptions,
    follow,
    r2_held_out,
    run_trial,
    split_of,
)
from torch_align_ae.processes import Processes, started_by_torchrun

TrialName = Literal["literal", "measured", "short", "sequence_split", "all_frames"]


@dataclass(frozen=True)
class TrainAutoencoderConfig(TrialOptions):
    """Train the mesh autoencoder: about 0.9 s a step of 64 frames on two cores, 1.5 GB of memory.

    Several processes, on several machines that see the same runs, share each batch when torchrun
    starts them: `torchrun --nproc-per-node 2 --no-python dsnet train-ae --run RUN`.

    Gives `autoencoder.safetensors` (weights and normaliser), `pca.safetensors`, the linear code of
    the same frames and size, the losses, and the share of the validation offsets' energy that both
    keep.
    """

    run: str = "demo"
    """Folder under runs/ that holds the aligned offsets."""
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
    comparison_epochs: Fixed[NonNegativeInt] = 0
    """Passes of each of `comparisons`; 0: as long as the training itself."""
    dmpl: Path | None = None
    """DMPL's `model.npz`, beside licensed meshes: its 8 directions become a third code, on which
    a predictor of a plugin can be trained."""


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


def main(config: TrainAutoencoderConfig) -> None:
    """Run the stage: a result that is current is kept, one that was interrupted is continued."""
    align = Run(config.run).artifact("align")
    if config.dmpl:
        _check_dmpl(config.dmpl, align)
    keep_freed_memory()
    with started_by_torchrun() as processes:
        if not processes.leads:
            follow(align, processes)
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


def _make(
    config: TrainAutoencoderConfig, align: Artifact, writer: ArtifactWriter, processes: Processes
) -> None:
    codec, result, summary = run_trial(config, _main_trial(config), align, writer, processes)
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
        _codec, result, summary = run_trial(length, trial, align, writer, processes)
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


def _fitted_pca(config: TrainAutoencoderConfig, align: Artifact) -> PcaCodec:
    """Of the frames that the autoencoder is trained on."""
    frames = split_of(config, _main_trial(config), align).train
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
    split = split_of(config, _main_trial(config), align)
    return {
        "components": len(codec.components),
        "r2_validation": reconstruction_r2(codec, offsets_m, split.validation),
        "r2_held_out": r2_held_out(codec, align),
    }


def parameter_counts() -> dict[str, int]:
    """Trainable parameters of the built models (Section 5), without allocating them."""
    with torch.device("meta"):
        return {
            "mesh_autoencoder": parameter_count(MeshAutoencoder()),
            "mesh_autoencoder_alternative": parameter_count(MeshAutoencoder(ALTERNATIVE_WIDTHS)),
            "casas_otaduy": parameter_count(CasasOtaduyAutoencoder()),
        }
