"""`dsnet plan`: what a run will cost, before anything is made."""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.measure.stage_evaluate import PROFILES as EVALUATE
from bridge.motion import MotionSequence
from bridge.motion.motion_file import read_motion_file
from bridge.motion.motion_folder import find_motion_files, subject_and_motion
from bridge.motion.resampling import DEFAULT_FPS, resampled_frames
from bridge.motion.sequences import subjects_of
from bridge.plan.costs import Material, Settings, Work, frames_of, rate_name, works
from bridge.plan.rates import MEASURED, RATES
from bridge.plan.request import PlanConfig, settings_of
from bridge.report.stage_report import PROFILES as REPORT
from bridge.runs import Run, read_artifact
from bridge.runs.folders import is_finished, partial_folder, runs_root
from bridge.runs.processes import answer_of_module

PROFILES = {
    "smoke": PlanConfig(run="smoke", profile="smoke"),
    "demo": PlanConfig(run="demo", profile="demo"),
    "paper": PlanConfig(run="paper", profile="paper"),
}
# Each imports its own framework, so that they are processes.
_SIDES = ("torch_align_ae.plan", "tf_dsnet.plan")
_LINE = 100
_BEST_ROAD = ("train_plus", "predict_plus")
State = Literal["", "begun", "done"]


@dataclass(frozen=True)
class PlannedStage:
    """One row of the plan."""

    name: str
    work: Work
    seconds: float
    """Estimated; 0 if the stage is done."""
    memory_bytes: int
    """Largest resident memory, estimated; mapped files count."""
    state: State

    @property
    def disk_bytes(self) -> int:
        """What is still to be written."""
        return 0 if self.state == "done" else self.work.disk_bytes


def main(config: PlanConfig) -> None:
    """Print the plan.

    Raises
    ------
    DsnetError
        If an input is missing or is not what it should be.
    """
    run = Run(config.run)
    settings, material = _asked(config)
    stages = _planned(run.path, settings, material)
    lines = [_head(config, material), "", *_table(stages), "", *_notes(stages)]
    sys.stdout.write("\n".join(lines) + "\n")


def _asked(config: PlanConfig) -> tuple[Settings, Material]:
    """The settings of all stages, and the sequences, as the stages' own modules say."""
    if (config.smpl is None) != (not config.dyna):
        raise DsnetError(
            "one of --smpl and --dyna", "both, or neither for a synthetic corpus", "Pass the other."
        )
    with ThreadPoolExecutor() as pool:
        answers = pool.map(lambda side: answer_of_module(side, *config.arguments()), _SIDES)
        torch_side, keras_side = map(json.loads, answers)
    settings = torch_side["settings"] | keras_side["settings"]
    settings["evaluate"] = settings_of(EVALUATE[config.profile])
    settings["report"] = settings_of(REPORT[config.profile])
    if "align_robust" not in settings and settings["align"]["aligner"] != "robust":
        settings = {name: own for name, own in settings.items() if name not in _BEST_ROAD}
    sequences = [MotionSequence(**entry) for entry in torch_side["sequences"]]
    if config.amass is not None:
        sequences = _with_motions_of(config.amass, config, sequences)
    return settings, Material(sequences)


def _with_motions_of(
    folder: Path, config: PlanConfig, sequences: Iterable[MotionSequence]
) -> list[MotionSequence]:
    """The aligned sequences, and the motions below `folder` in place of the corpus's own."""
    aligned = [sequence for sequence in sequences if sequence.split != "test"]
    body = load_body_model(str(config.smpl or f"embedded:{config.gender}"))
    found = find_motion_files(folder, body.gender, [sequence.name for sequence in aligned])
    return [*aligned, *(_motion(path, config.amass_fps) for path in found)]


def _motion(path: Path, source_fps: float | None) -> MotionSequence:
    subject, motion = subject_and_motion(path)
    stored = read_motion_file(path)
    length = resampled_frames(len(stored.pose), source_fps or stored.fps)
    return MotionSequence(f"{subject}_{motion}", subject, motion, 0, length, DEFAULT_FPS, "test")


def _planned(folder: Path, settings: Settings, material: Material) -> list[PlannedStage]:
    stages: list[PlannedStage] = []
    done: set[str] = set()
    for name, work in works(settings, material).items():
        state = _state(folder / name, settings, done)
        rate = RATES[rate_name(name, settings)]
        seconds = 0.0 if state == "done" else rate.seconds * work.amount / rate.amount
        memory = rate.memory_mb * 2**20 + work.mapped_bytes
        stages.append(PlannedStage(name, work, seconds, memory, state))
        done |= {name} if state == "done" else set()
    return stages


def _state(folder: Path, settings: Settings, done: set[str]) -> State:
    """Whether the stage's artifact is one of these settings, made from stages that stay.

    Input files are not compared: a plan reads nothing large.
    """
    if is_finished(folder):
        manifest = read_artifact(folder).manifest
        sources = [name for name in manifest["upstream"] if name in settings]
        if manifest["config"] == settings[folder.name] and done.issuperset(sources):
            return "done"
    return "begun" if partial_folder(folder).is_dir() else ""


def _head(config: PlanConfig, material: Material) -> str:
    aligned, predicted = material.aligned, material.sequences[len(material.aligned) :]
    data = "licensed files" if config.dyna else f"synthetic, {config.gender}"
    return (
        f"Run {config.run!r}, profile {config.profile}, seed {config.seed}, {data}: "
        f"{len(aligned)} sequences of {len(subjects_of(aligned))} people, "
        f"{frames_of(aligned):,} frames; to predict besides {len(predicted)} motions, "
        f"{frames_of(predicted):,} frames."
    )


def _table(stages: list[PlannedStage]) -> list[str]:
    rows: list[tuple[str, ...]] = [("stage", "work", "time", "memory", "disk", "")]
    for one in stages:
        cost = "-" if one.state == "done" else _duration(one.seconds)
        memory = "-" if one.state == "done" else _size(one.memory_bytes)
        disk = "-" if one.state == "done" else _size(one.disk_bytes)
        rows.append((one.name, one.work.text, cost, memory, disk, one.state))
    left = [one for one in stages if one.state != "done"]
    rows.append(
        (
            "together",
            "",
            _duration(sum(one.seconds for one in left)),
            _size(max((one.memory_bytes for one in left), default=0)),
            _size(sum(one.disk_bytes for one in left)),
            "",
        )
    )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.ljust(width) if place in (0, 1, 5) else text.rjust(width)
            for place, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _notes(stages: list[PlannedStage]) -> list[str]:
    needed = peak_bytes(stages)
    root = runs_root().resolve()
    free = shutil.disk_usage(next(p for p in (root, *root.parents) if p.is_dir())).free
    verdict = "enough" if free >= needed else "NOT ENOUGH"
    estimates = (
        "Times are estimates for two cores with nothing else to do: each stage's work at what it "
        f"took in run {MEASURED.run!r}, measured on {MEASURED.machine}, {MEASURED.day}. Short runs "
        "take longer, for a stage needs seconds to start. Memory counts files that are mapped into "
        "it, whose pages the system takes back when it is short."
    )
    notes = [
        f"Disk: {_size(needed)} needed at most, {_size(free)} free at {root}: {verdict}.",
        *textwrap.wrap(estimates, _LINE),
    ]
    if any(one.state == "begun" for one in stages):
        notes.append(
            "A stage that is begun goes on from its last checkpoint; its row is the whole."
        )
    return notes


def peak_bytes(stages: Iterable[PlannedStage]) -> int:
    """The most that a run still adds to the disk at any moment."""
    written = peak = 0
    for one in stages:
        if one.state != "done":
            written += one.disk_bytes
            peak = max(peak, written + one.work.scratch_bytes)
    return peak


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 3600 else f"{seconds / 3600:.1f} h"


def _size(size_bytes: float) -> str:
    return f"{size_bytes / 1e9:.1f} GB" if size_bytes >= 5e7 else f"{size_bytes / 1e6:.0f} MB"
