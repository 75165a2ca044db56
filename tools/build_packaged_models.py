"""Train and pack the small models that come with the package: female and male.

    python tools/build_packaged_models.py [--profile demo] [--seed 0]

For each gender it makes the synthetic corpus, aligns it by the robust aligner and trains
`dsnet_plus` in a run of its own, `packaged_<gender>` (what is there already is used), then writes
`dsnet/prediction/packaged/<gender>/`. What training found of single people of the corpus as a
constant is left out: nobody else has exactly their shapes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from benchmarks.processes import run_dsnet
from bridge.exchange import save_weights
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.tissue.trained_plus import NAME, StaticPart, TrainedPlus
from dsnet.prediction.load_model import PACKAGED, packaged_folder

GENDERS = ("female", "male")


@dataclass(frozen=True)
class BuildConfig:
    """What the models are trained on."""

    profile: str = "demo"
    """Size of the synthetic corpus."""
    seed: int = 0
    """Of corpus and training."""


def main(config: BuildConfig) -> None:
    """Build both."""
    for gender in GENDERS:
        run = Run(f"packaged_{gender}")
        common = ("--profile", config.profile, "--run", run.name, "--seed", str(config.seed))
        run_dsnet("corpus", "--gender", gender, *common)
        run_dsnet("align", "--aligner", "robust", *common)
        run_dsnet("train", "--predictors", NAME, *common)
        pack(run.artifact("train_plus"), packaged_folder(gender), gender, config)
        sys.stdout.write(f"{packaged_folder(gender)}\n")


def pack(trained: Artifact, folder: Path, gender: str, config: BuildConfig) -> Artifact:
    """Write a finished `train_plus` as a packaged model."""
    model = TrainedPlus.load(trained)
    nothing = StaticPart.nothing()
    by_pose_m = model.static.by_pose_m if model.static.by_pose_m.any() else nothing.by_pose_m
    model = replace(model, static=StaticPart(nothing.constant_m, by_pose_m))
    writer = ArtifactWriter(folder, PACKAGED, data=trained.origin)
    save_weights(writer.file_path(f"{NAME}.safetensors"), model.arrays())
    writer.record(predictors={NAME: {"label": trained.manifest["predictors"][NAME]["label"]}},
                  default=NAME, gender=gender)  # fmt: skip
    settings = {"profile": config.profile, "seed": config.seed}
    return writer.finish(config=settings, upstream={"train_plus": trained.content_sha256})


if __name__ == "__main__":
    main(tyro.cli(BuildConfig))
