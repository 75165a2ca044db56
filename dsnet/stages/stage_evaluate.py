"""`dsnet evaluate`: a run's predictions beside its meshes, or a predictor beside skin markers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tyro.conf import Fixed

from bridge.errors import DsnetError, notify
from bridge.motion.motion import HowRead
from bridge.options import PositiveFloat
from bridge.paper import FPS
from bridge.runs import Run
from dsnet.evaluation.evaluation import evaluate_run
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.comparison_files import write_comparisons
from dsnet.markers.lone import Lone, lone_motion, measure_alone
from dsnet.markers.marker_files import is_lone, load_recording, markers_of
from dsnet.markers.registration import Registered, register
from dsnet.markers.skin import compare_offsets
from dsnet.prediction.load_model import load_model
from dsnet.prediction.moving_body import MovingBody, persons_root_joint_m
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.shape_space import with_betas_on

_OF_FILE, _ON_BONE = "pose of the file", "pose whose chest follows markers on bone"
_OF_MARKERS = "pose fitted to markers on bone"


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
    recording (`.c3d`, `.trc`, `.tsv`, `.csv`), to whose markers on bone a body is fitted if no pose
    file of the same name lies beside it."""
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
    lone = Lone.read(markers, config.motion_fps) if is_lone(markers) else None
    alone = None if lone is None else measure_alone(lone)
    compared = _compared(run, markers, config.motion_fps, lone)
    with open_out_folder(out, "licensed", "evaluation of markers") as writer:
        if compared is None:
            write_comparisons(writer.file_path, {}, FPS, alone)
            writer.record(source=markers.name, fps=FPS)
            writer.finish(config={"run": run and run.name})
            return
        bodies, registered = compared
        trained, motion = bodies[0].trained, bodies[0].motion
        bodies[0].announce()
        names = (_OF_FILE if lone is None else _OF_MARKERS, _ON_BONE)
        comparisons = {}
        for name, body in zip(names, bodies, strict=False):
            offsets_m = np.concatenate([part.offsets_m for part in body.shown(name)])
            comparisons[name] = compare_offsets(body.body, body.motion, offsets_m, registered)
        write_comparisons(writer.file_path, comparisons, motion.fps, alone)
        writer.record(
            predictor=trained.name,
            source=markers.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
            distance_mm={name: round(d, 1) for name, d in registered.distance_mm.items()},
        )
        writer.finish(config={"run": run and run.name}, upstream=trained.upstream)


def _compared(
    run: Run | None, markers: Path, fps: float | None, lone: Lone | None
) -> tuple[list[MovingBody], Registered] | None:
    """The body in the pose of the file, or of markers on bone where there is none, and with its
    chest by those, and the markers on it; None where too few of a recording without a pose are on
    bone."""
    motion = None if lone else load_recording(markers, fps, HowRead(up="z"))
    trained = load_model(run, None, motion.gender if motion else "unknown")
    if lone is not None:
        try:
            motion = lone_motion(trained.body, lone)
        except DsnetError as error:
            notify(f"the markers alone are measured: {error}")
            return None
    assert motion is not None
    motion = with_betas_on(motion, trained.body)  # where it is, the markers say
    motion = motion.about_root_joint(persons_root_joint_m(motion, trained.body))
    moving = MovingBody(trained, motion)
    read = markers_of(motion)
    if read.note:
        notify(f"{markers}: {read.note}")
    registered = register(moving.body, motion, read)
    try:
        on_bone = bone_motion(moving.body, motion, registered.cloud)
    except DsnetError as error:
        notify(f"the pose of the file alone is measured: {error}")
        return [moving], registered
    return [moving, MovingBody(trained, on_bone)], registered
