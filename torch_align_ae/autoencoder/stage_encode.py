"""`dsnet encode`: offsets of all frames to latents (Section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from bridge.exchange.dsnet import LATENTS_OF, UNITS
from bridge.motion import MotionSequence, sequences_of, to_manifest
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.workers import on_any_node, progress
from torch_align_ae.autoencoder.codes import load_codecs
from torch_align_ae.workers import torch_workers


@dataclass(frozen=True)
class EncodeConfig:
    """Encode all aligned offsets: about 2 ms a frame on two cores, 1 GB of memory.

    Gives the latents that DSNet learns to predict, and those of the linear codes.
    """

    run: str = "demo"
    """Folder under runs/ that holds the aligned offsets and the autoencoder."""


PROFILES = {name: EncodeConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: EncodeConfig) -> None:
    run = Run(config.run)
    upstream = run.artifacts("align", "train-ae")
    make = partial(_make, *upstream.values())
    run.build("encode", config, make, data=upstream["align"].origin, upstream=upstream)


def _make(align: Artifact, trained: Artifact, writer: ArtifactWriter) -> None:
    sequences, codecs = sequences_of(align), load_codecs(trained)
    frames = sum(sequence.length for sequence in sequences)
    latents = {}
    for code, codec in codecs.items():
        shape = (frames, codec.latent_size)
        latents[code] = writer.array_file(LATENTS_OF[code], shape, np.float32, UNITS[code])

    def encode(align: Artifact, sequence: MotionSequence) -> None:
        offsets_m = align.array("offsets")
        for piece in sequence.pieces():
            for code, codec in codecs.items():
                latents[code].write(piece.start, codec.encode(offsets_m[piece]))

    with torch_workers(on_any_node("threads"), align) as pool:
        done = pool.map(encode, sequences)
        for _ in progress(done, what="encode", unit="sequence", total=len(sequences)):
            pass
    writer.put("theta", align.array("theta"), "rad, then m")
    writer.put("betas", align.array("betas"), "1")
    writer.record(sequences=to_manifest(sequences))
