"""`dsnet decode`: predicted latents to offsets, for the sequences that are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from bridge.exchange.dsnet import AUTOENCODER, LATENTS_OF
from bridge.motion import MotionSequence, sequences_of, to_manifest
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import decoded_sequences
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.workers import on_any_node, progress
from torch_align_ae.autoencoder.codes import load_codecs
from torch_align_ae.workers import torch_workers


@dataclass(frozen=True)
class DecodeConfig:
    """Decode DSNet's latents: about 3 ms a frame and array on two cores, 1 GB of memory.

    Gives the offsets of the validation and test sequences and of one training sequence per subject:
    `offsets_<name>` of each predictor, and the autoencoder's reconstruction of aligned offsets.
    """

    run: str = "demo"
    """Folder under runs/ that holds the predictions."""


PROFILES = {name: DecodeConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: DecodeConfig) -> None:
    run = Run(config.run)
    upstream = run.artifacts("infer", "encode", "train-ae")
    make = partial(_make, *upstream.values())
    run.build("decode", config, make, data=upstream["encode"].origin, upstream=upstream)


def _make(infer: Artifact, encode: Artifact, trained: Artifact, writer: ArtifactWriter) -> None:
    chosen, codecs = decoded_sequences(sequences_of(infer)), load_codecs(trained)
    placed = end_to_end(chosen)
    shape = (placed[-1].frames.stop, trained.manifest["architecture"]["widths"][0], 3)
    predictors, codes = infer.manifest["predictors"], infer.manifest.get("codes", {})
    offsets = {
        name: writer.array_file(f"offsets_{name}", shape, np.float32, "m")
        for name in (*predictors, AUTOENCODER)
    }
    aligned = {sequence.name: sequence for sequence in sequences_of(encode)}

    def decode(infer: Artifact, item: tuple[MotionSequence, MotionSequence]) -> None:
        source, target = item
        latents = {name: infer.array(f"latents_{name}")[source.frames] for name in predictors}
        # Test sequences are not aligned: their rows stay zero.
        if sequence := aligned.get(source.name):
            latents[AUTOENCODER] = encode.array(LATENTS_OF[AUTOENCODER])[sequence.frames]
        for name, values in latents.items():
            codec = codecs[codes.get(name, AUTOENCODER)]
            for piece in target.pieces():
                rows = slice(piece.start - target.start, piece.stop - target.start)
                offsets[name].write(piece.start, codec.decode(values[rows]))

    with torch_workers(on_any_node("threads"), infer) as pool:
        done = pool.map(decode, list(zip(chosen, placed, strict=True)))
        for _ in progress(done, what="decode", unit="sequence", total=len(chosen)):
            pass
    writer.record(
        sequences=to_manifest(placed), predictors=predictors, default=infer.manifest["default"]
    )
