"""`dsnet decode`: predicted latents back to offsets, for the sequences that are evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from bridge.exchange.codes import AUTOENCODER, CodeName
from bridge.motion import sequences_of, to_manifest
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import decoded_sequences
from bridge.runs import Artifact, ArtifactWriter, Run
from torch_align_ae.autoencoder.codec import load_codecs
from torch_align_ae.autoencoder.pca import OffsetCodec


@dataclass(frozen=True)
class DecodeConfig:
    """Decode DSNet's latents: about 3 ms a frame and array on two cores, 1 GB of memory.

    Gives the offsets of the validation and test sequences and of one training sequence a subject:
    `offsets_<name>` of each predictor, and the autoencoder's own of the aligned offsets.
    """

    run: str = "demo"
    """Folder under runs/ that holds the predictions."""


PROFILES = {name: DecodeConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: DecodeConfig) -> None:
    """Run the stage; a result that is current is kept."""
    run = Run(config.run)
    upstream = run.artifacts("predict", "encode", "train-ae")
    run.build(
        "decode",
        config,
        lambda writer: _make(
            upstream["predict"], upstream["encode"], load_codecs(upstream["train-ae"]), writer
        ),
        data=upstream["encode"].origin,
        upstream=upstream,
    )


def _make(
    predict: Artifact,
    encode: Artifact,
    codecs: Mapping[CodeName, OffsetCodec],
    writer: ArtifactWriter,
) -> None:
    chosen = decoded_sequences(sequences_of(predict))
    placed = end_to_end(chosen)
    aligned = {sequence.name: sequence for sequence in sequences_of(encode)}
    shape = (sum(sequence.length for sequence in chosen), codecs[AUTOENCODER].vertex_count, 3)
    predictors, codes = predict.manifest["predictors"], predict.manifest.get("codes", {})
    decoded = {
        name: writer.open_array(f"offsets_{name}", shape, np.float32, "m")
        for name in (*predictors, AUTOENCODER)
    }
    pairs = list(zip(chosen, placed, strict=True))
    for source, target in tqdm(pairs, desc="decode", unit="sequence", disable=None):
        latents = {name: predict.array(f"latents_{name}")[source.frames] for name in predictors}
        # Test sequences were never aligned: their rows keep the zeros of a new array.
        if known := aligned.get(source.name):
            latents[AUTOENCODER] = encode.array("latents")[known.frames]
        for name, values in latents.items():
            code = codecs[codes.get(name, AUTOENCODER)]
            for rows, piece in zip(source.pieces(), target.pieces(), strict=True):
                own = slice(rows.start - source.start, rows.stop - source.start)
                decoded[name][piece] = code.decode(values[own])
    writer.record(
        sequences=to_manifest(placed), predictors=predictors, default=predict.manifest["default"]
    )
