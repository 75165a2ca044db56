"""`dsnet evaluate`: a run's predictions beside its meshes, or a predictor beside skin markers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tyro.conf import Fixed

from bridge.errors import DsnetError, notify
from bridge.motion.motion import HowRead
from bridge.options import PositiveFloat
from bridge.runs import Run
from dsnet.evaluation.evaluation import evaluate_run
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.comparison_files import write_comparisons
from dsnet.markers.marker_files import load_recording, markers_of
from dsnet.markers.registration import register
from dsnet.markers.skin import compare_offsets
from dsnet.prediction.load_model import load_model
from dsnet.prediction.moving_body import MovingBody, persons_root_joint_m
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.shape_space import with_betas_on

_OF_FILE, _ON_BONE = "pose of the file", "pose whose chest follows markers on bone"


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure the errors of all predictions of a run: about 5 ms a frame, 1 GB of memory.

    Compares posed meshes with the registered ones and, for synthetic data, with the true meshes of
    sequences that were not aligned; offsets by R2, velocity and spectrum, for each test group. With
    --markers it compares a predictor with real skin markers instead: on the pose of the file and,
    as such poses contain part of the bounce, on one whose chest follows markers on bone.
    """

    run: str | None = None
    """Run to evaluate; with --markers the run whose predictor moves the skin, by default the
    packaged model."""
    markers: Path | None = None
    """Motion with real skin markers: an AMASS `.npz` that has them, a MoSh++ `*_stageii.pkl`, or a
    `.c3d` beside a pose file of the same name."""
    motion_fps: PositiveFloat | None = None
    """Frame rate of the motion in frames per second, where its file has a wrong one."""
    out: Path | None = None
    """Folder to write with --markers: a table, a figure, the numbers."""
    profile: Fixed[str] = "demo"
    """Name of the run that is evaluated when no other is named."""


PROFILES = {name: EvaluateConfig(profile=name) for name in ("smoke", "demo", "paper")}


def main(config: EvaluateConfig) -> None:
    """Evaluate a run, or a predictor beside markers."""
    if config.markers is None and (config.out or config.motion_fps):
        raise DsnetError(
            "--out or --motion-fps without --markers",
            "them beside markers alone: a run is evaluated in its folder",
            "Leave them out, or pass --markers FILE.",
        )
    if config.markers is None:
        evaluate_run(Run(config.run or config.profile))
    elif config.out is None:
        raise DsnetError("--markers without --out", "a folder to write", "Pass --out DIR.")
    else:
        evaluate_markers(config, config.markers, config.out)


def evaluate_markers(config: EvaluateConfig, markers: Path, out: Path) -> None:
    """Compare what a predictor makes of a motion with the markers of that motion."""
    run = None if config.run is None else Run(config.run)
    motion = load_recording(markers, config.motion_fps, HowRead(up="z"))
    trained = load_model(run, None, motion.gender)
    motion = with_betas_on(motion, trained.body)  # where it is, the markers say
    motion = motion.about_root_joint(persons_root_joint_m(motion, trained.body))
    moving = MovingBody(trained, motion)
    read = markers_of(motion)
    if read.note:
        notify(f"{markers}: {read.note}")
    registered = register(moving.body, motion, read)
    bodies = {_OF_FILE: moving}
    try:
        on_bone = bone_motion(moving.body, motion, registered.cloud)
        bodies[_ON_BONE] = MovingBody(trained, on_bone)
    except DsnetError as error:
        notify(f"the pose of the file alone is measured: {error}")
    with open_out_folder(out, "licensed", "evaluation of markers") as writer:
        moving.announce()
        comparisons = {}
        for name, body in bodies.items():
            offsets_m = np.concatenate([part.offsets_m for part in body.shown(name)])
            comparisons[name] = compare_offsets(body.body, body.motion, offsets_m, registered)
        write_comparisons(writer.file_path, comparisons, motion.fps)
        writer.record(
            predictor=trained.name,
            source=markers.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
            distance_mm={name: round(d, 1) for name, d in registered.distance_mm.items()},
        )
        writer.finish(config={"run": run and run.name}, upstream=trained.upstream)
