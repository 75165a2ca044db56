"""`dsnet evaluate`: a run's predictions beside its meshes, or a prediction beside skin markers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.markers.bony import bony_motion
from bridge.markers.marker_files import read_markers
from bridge.markers.page import write_comparisons
from bridge.markers.predicted import Registered, compare_offsets, pose_of, register
from bridge.markers.skin import Comparison
from bridge.measure.stage_evaluate import evaluate_run
from bridge.options import PositiveFloat
from bridge.runs import Run
from bridge.runs.processes import notify
from bridge.runtime.characters import open_for_motion
from bridge.runtime.controls import Controls, controlled_body
from bridge.runtime.moving_body import MovingBody
from bridge.runtime.out_folder import open_out_folder

_OF_FILE, _BONY = "pose of the file", "pose whose chest follows markers on bone"


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure every prediction of both pipelines of a run: about 5 ms a frame, 1 GB.

    Gives errors of the posed meshes against the registered ones, which a licensed user has too, and
    for synthetic data against the true meshes of unseen motions; R2, velocity, spectrum, decay and
    rest of the offsets, by test group. With --markers it measures instead how a predictor moves
    skin where somebody's markers were: on the pose of the file and, as such poses hold part of the
    bounce, on one whose chest follows markers on bone.
    """

    run: str | None = None
    """Run to evaluate; with --markers the run whose predictor moves the skin, the packaged model
    when left out."""
    markers: Path | None = None
    """Skin markers: an AMASS `.npz` with `marker_data`, or a C3D beside --motion."""
    motion: Path | None = None
    """Pose of the markers' motion; that in the file of the markers when left out."""
    motion_fps: PositiveFloat | None = None
    """Frames per second of the motion file, where what it says of itself is wrong."""
    predictor: str | None = None
    """Which of the run's predictors moves the skin beside markers; its best when left out."""
    out: Path | None = None
    """Folder to write what markers say to: a table, a figure, numbers."""


PROFILES = {name: EvaluateConfig(run=name) for name in ("smoke", "demo", "paper")}


def main(config: EvaluateConfig) -> None:
    """Evaluate."""
    if config.markers is None:
        evaluate_run(Run(config.run or "demo"))
    elif config.out is None:
        raise DsnetError("--markers without --out", "a folder to write", "Pass --out DIR.")
    else:
        evaluate_markers(config, config.markers, config.out)
