"""`dsnet decode`: predicted latents back to offsets, for the sequences that are evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bridge.exchange.dsnet import AUTOENCODER, LATENTS_OF, CodeName
from bridge.motion import MotionSequence, sequences_of, to_manifest
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import decoded_sequences
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.files import ArrayFile
from bridge.runs.workers import on_any_node, progress
from torch_align_ae.autoencoder.codec import load_codecs
from torch_align_ae.autoencoder.pca import OffsetCodec
from torch_align_ae.workers import torch_workers


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
    upstream = run.artifacts("infer", "encode", "train-ae")
    run.build(
        "decode",
        config,
        lambda writer: _make(
            upstream["infer"], upstream["encode"], load_codecs(upstream["train-ae"]), writer
        ),
        data=upstream["encode"].origin,
        upstream=upstream,
    )


@dataclass(frozen=True)
class _Decoding:
    """What a worker needs to decode sequences."""

    predict: Artifact
    encode: Artifact
    codecs: Mapping[CodeName, OffsetCodec]
    offsets: Mapping[str, ArrayFile]


def _make(
    predict: Artifact,
    encode: Artifact,
    codecs: Mapping[CodeName, OffsetCodec],
    writer: ArtifactWriter,
) -> None:
    chosen = decoded_sequences(sequences_of(predict))
    placed = end_to_end(chosen)
    shape = (sum(sequence.length for sequence in chosen), codecs[AUTOENCODER].vertex_count, 3)
    predictors = predict.manifest["predictors"]
    offsets = {
        name: writer.array_file(f"offsets_{name}", shape, np.float32, "m")
        for name in (*predictors, AUTOENCODER)
    }
    aligned = {sequence.name: sequence for sequence in sequences_of(encode)}
    items = [
        (source, target, aligned.get(source.name))
        for source, target in zip(chosen, placed, strict=True)
    ]
    stage = _Decoding(predict, encode, codecs, offsets)
    with torch_workers(on_any_node("threads"), stage) as pool:
        done = pool.map(_decode, items)
        for _ in progress(done, what="decode", unit="sequence", total=len(items)):
            pass
    writer.record(
        sequences=to_manifest(placed), predictors=predictors, default=predict.manifest["default"]
    )


def _decode(
    stage: _Decoding, item: tuple[MotionSequence, MotionSequence, MotionSequence | None]
) -> None:
    source, target, known = item
    predictors, codes = (
        stage.predict.manifest["predictors"],
        stage.predict.manifest.get("codes", {}),
    )
    latents = {name: stage.predict.array(f"latents_{name}")[source.frames] for name in predictors}
    # Test sequences were never aligned: their rows keep the zeros of a new array.
    if known is not None:
        latents[AUTOENCODER] = stage.encode.array(LATENTS_OF[AUTOENCODER])[known.frames]
    for name, values in latents.items():
        codec = stage.codecs[codes.get(name, AUTOENCODER)]
        for piece in target.pieces():
            own = slice(piece.start - target.start, piece.stop - target.start)
            stage.offsets[name].write(piece.start, codec.decode(values[own]))
