"""`python -m torch_align_ae.plan`: settings of this side's stages and the run's sequences, JSON."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from bridge.body import load_body_model
from bridge.motion import MotionSequence, to_manifest
from bridge.motion.resampling import resampled_frames
from bridge.motion.sequences import end_to_end
from bridge.plan.request import PlanConfig, seeded, settings_of
from bridge.runs.processes import run_as_process
from torch_align_ae.alignment import stage_align
from torch_align_ae.alignment.stage_align import AlignConfig
from torch_align_ae.autoencoder import stage_decode, stage_encode, stage_train_ae
from torch_align_ae.corpus import stage_corpus
from torch_align_ae.corpus.dyna_files import FPS, DynaReader
from torch_align_ae.corpus.dyna_layout import DynaEntry, of_one_gender
from torch_align_ae.corpus.sequences import MOSH_FPS
from torch_align_ae.corpus.takes import Takes


def main(config: PlanConfig) -> None:
    """Print what stages of this profile would be given; nothing is made."""
    align = stage_align.PROFILES[config.profile]
    align = replace(
        align, aligner=config.aligner or align.aligner, smpl=config.smpl, dyna=config.dyna
    )
    sequences = _licensed(align) if align.dyna else _synthetic(config, align)
    settings = {name: settings_of(own) for name, own in _configs(config, align).items()}
    answer = {"settings": settings, "sequences": to_manifest(end_to_end(sequences))}
    sys.stdout.write(json.dumps(answer))


def _configs(config: PlanConfig, align: AlignConfig) -> dict[str, Any]:
    """Configurations by artifact, as their manifests record them."""
    corpus = _corpus(config)
    return {
        **({} if align.dyna else {"truth": corpus, "corpus": corpus}),
        **stage_align.records_of(align),
        "train-ae": seeded(stage_train_ae.PROFILES[config.profile], config.seed),
        "encode": stage_encode.PROFILES[config.profile],
        "decode": stage_decode.PROFILES[config.profile],
    }


def _corpus(config: PlanConfig) -> stage_corpus.CorpusConfig:
    corpus = seeded(stage_corpus.PROFILES[config.profile], config.seed)
    return replace(corpus, gender=config.gender)


def _licensed(align: AlignConfig) -> list[MotionSequence]:
    """The files' own, as `align` takes them."""
    with DynaReader(align.dyna) as reader:
        entries = of_one_gender(reader.entries, load_body_model(str(align.smpl)).gender)
    return stage_align.index_of(entries, align.validation)


def _synthetic(config: PlanConfig, align: AlignConfig) -> list[MotionSequence]:
    """Those that the corpus would hold, and its test motions at the rate of the meshes.

    In the order of a mesh file's keys, which decides what is decoded.
    """
    takes = Takes.of(_corpus(config))
    entries = [
        DynaEntry(take.name, take.subject.name, take.motion, take.frame_count, Path("corpus"))
        for take in sorted(takes.dyna, key=lambda take: take.name)
    ]
    tests = [
        MotionSequence(
            take.name,
            take.subject.name,
            take.motion,
            0,
            resampled_frames(take.frame_count, MOSH_FPS),
            FPS,
            "test",
        )
        for take in takes.held_out
    ]
    return [*stage_align.index_of(entries, align.validation), *tests]


if __name__ == "__main__":
    run_as_process(PlanConfig, main)
