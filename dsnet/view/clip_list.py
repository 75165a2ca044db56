"""What there is to be seen: motions, people and predictors, of a run or of the package.

The simulated truth is to be looked at beside predictions: nothing is computed from it but errors.
Apart from evaluation and the report this is the one reader, and what it reads reaches no predictor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.exchange.dsnet import dsnets_of
from bridge.motion import Motion, MotionSequence, load_motion, sequences_of, subject_rows
from bridge.motion.motion import HowRead
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import subject_and_motion
from bridge.motion.readers.amass import SAMPLE_PREFIX, SAMPLES
from bridge.paper import FPS
from bridge.runs import Artifact, Run
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT, TRAIN
from dsnet.evaluation.pipelines import MotionArrays
from dsnet.markers.bone_pose import flesh_in_pose
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import PIPELINES, TrainedModel, load_model
from dsnet.prediction.moving_body import MovingBody, place_motion
from dsnet.prediction.shape_space import with_betas_on

AVERAGE = "average shape"
TRUTH = "truth"
_KINDS = {"train": "trained on", "validation": "held out", "test": "unseen"}


@dataclass(frozen=True, eq=False)
class ViewedMotion:
    """One motion that can be chosen."""

    read: Callable[[], Motion]
    """The motion of its own person, y up."""
    sequence: str = ""
    """Its name among the run's, by which its truth is found where that is known."""


@dataclass(frozen=True, eq=False)
class Repertoire:
    """Everything that one viewer can show; all of it moves the same body model."""

    best: TrainedModel
    """The predictor to be shown first, whose body moves."""
    predictors: Mapping[str, str]
    """Labels by name, the best first."""
    open: Callable[[str], TrainedModel]
    """A predictor by name."""
    takes: Mapping[str, ViewedMotion]
    """By what the picker calls them, the first to be shown first."""
    people: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Shapes (10,) by name, besides each motion's own person."""
    truth: MotionArrays | None = None
    """True poses, shapes and offsets, where any are known."""

    def truth_of(self, take: ViewedMotion) -> MotionSequence | None:
        """Where in the truth a motion stands, if it does."""
        return self.truth.sequences.get(take.sequence) if self.truth else None


def open_repertoire(
    run: Run | None, path: Path | None, controls: Controls | None = None
) -> Repertoire:
    """Everything that can be shown with a run's predictors, or with the packaged one.

    Parameters
    ----------
    path : a motion to be shown first, of any format that is read, or a sample.
    controls : how that is read and posed, and of whose body; on another body than the predictor was
        trained on a run's own sequences and people are left out.
    """
    asked, takes = controls or Controls(), {}
    if path is None:
        best = asked.model(run, None)
    else:
        best, motion = asked.load(run, None, path)
        moving = controlled_body(best, motion, asked)
        flesh = [] if asked.pose == "bony" else flesh_in_pose(motion)
        for warning in (*motion_warnings(moving.motion, moving.pieces), *flesh):
            notify(warning)
        takes[path_title(path)] = ViewedMotion(lambda: moving.motion)
    model = cache(lambda name: best if name == best.name else load_model(run, name))
    people = {AVERAGE: np.zeros(best.body.shapedirs.shape[-1])}
    found = Repertoire(best, {best.name: best.label}, model, takes, people)
    if run is None or best.other_body is not None:
        samples = [Path(SAMPLE_PREFIX + name) for name in SAMPLES]
        others = {path_title(sample): _of_file(sample, best.body) for sample in samples}
        return replace(found, takes=takes | others | takes)
    align = run.artifact(ROBUST_ALIGNMENT if run.finished(ROBUST_ALIGNMENT) else ALIGNMENT)
    for take, split in _recorded(run, align, best.body):
        takes[f"{take.sequence} ({_KINDS[split]})"] = take
    if not takes:
        raise DsnetError(f"run {run.name!r} without motions", "a motion", "Pass --motion FILE.")
    return replace(
        found,
        predictors={**found.predictors, **_dsnets_of(run)},
        people=_people(align) | people,
        truth=open_truth(run, best.origin),
    )


def path_title(path: Path) -> str:
    """What the picker calls a file or a sample."""
    return path.stem.removeprefix(SAMPLE_PREFIX)


def open_truth(run: Run, origin: str) -> MotionArrays | None:
    """What really moved in a run's sequences, where it is known.

    `origin` is that of the run's meshes; the truth is of its own corpus, not of licensed ones.
    """
    known = origin == "synthetic" and run.finished(TRUTH)
    return MotionArrays.of(run.artifact(TRUTH)) if known else None


def take_of(moving: MovingBody) -> tuple[ViewedMotion, MotionArrays | None]:
    """A motion as it is moved, with its truth if it is one of its run's corpus, as recorded."""
    motion, trained = moving.motion, moving.trained
    first, *_ = trained.artifacts.values()
    folder, take = first.path.parent.resolve(), ViewedMotion(lambda: motion)
    recorded = not set(moving.controls) - {"gain", "part_gain"}
    if recorded and folder / "corpus" in motion.source.resolve().parents:
        sequence = "_".join(subject_and_motion(motion.source))
        return replace(take, sequence=sequence), open_truth(Run(folder.name), trained.origin)
    return take, None


def _dsnets_of(run: Run) -> dict[str, str]:
    """Labels of the paper's networks, where the run has all that moves bodies by them."""
    stages = next(stages for stages in PIPELINES if TRAIN in stages)
    if not all(map(run.finished, stages)):
        return {}
    trained = run.artifact(TRAIN)
    entries = trained.manifest["predictors"]
    return {name: entries[name].get("label", name) for name in dsnets_of(trained)}


def _of_file(path: Path, body: BodyModelData, sequence: str = "") -> ViewedMotion:
    def read() -> Motion:
        motion = load_motion(path, how=HowRead(up="z"))
        return place_motion(with_betas_on(motion, body), body)

    return ViewedMotion(read, sequence)


def _people(align: Artifact) -> dict[str, NDArray[np.float64]]:
    betas, rows = align.array("betas"), subject_rows(sequences_of(align))
    return {name: betas[row].astype(np.float64) for name, row in rows.items()}


def _recorded(run: Run, align: Artifact, body: BodyModelData) -> Iterator[tuple[ViewedMotion, str]]:
    """The sequences that the run's meshes show, as alignment saw them, those held out first; then
    the corpus's motions without meshes, on which predictors are tested. Each with its split."""
    people, theta = _people(align), align.array("theta")
    for one in sorted(sequences_of(align), key=lambda one: one.split != "validation"):
        motion = Motion(
            theta=theta[one.frames].astype(np.float64),
            betas=people[one.subject],
            gender=body.gender,
            fps=FPS,
            source_fps=one.fps,
            source=Path(one.name),
            trans_of="y",  # of whatever shape
        )
        yield ViewedMotion(lambda motion=motion: motion, one.name), one.split
    if "corpus" in align.manifest["upstream"]:
        corpus = run.artifact("corpus")
        for name in sorted(corpus.manifest["files"]):
            if name.endswith("_poses.npz"):
                path = corpus.file(name)
                yield _of_file(path, body, "_".join(subject_and_motion(path))), "test"
