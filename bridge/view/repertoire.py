"""What there is to be seen: motions, people and predictors, of a run or of the package.

The simulated truth is to be looked at beside predictions: nothing is computed from it but errors.
Apart from evaluation this is the one reader, and what it reads reaches no predictor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.exchange.dsnet import dsnets_of
from bridge.markers.bony import bony_pose, flesh_in_pose
from bridge.measure.pipelines import MotionArrays
from bridge.motion import Motion, load_amass_motion, load_motion_file, sequences_of, subject_rows
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion import AS_IT_SAYS, DEFAULT_FPS, HowRead, SmoothHz
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import subject_and_motion
from bridge.motion.readers.amass import SAMPLE_PREFIX, SAMPLES
from bridge.runs import Artifact, Run
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT
from bridge.runtime.load_model import PIPELINES, TrainedModel, load_model
from bridge.runtime.moving_body import MovingBody, place_motion
from bridge.runtime.whose_betas import with_own_shape

AVERAGE = "average shape"
TRUTH = "truth"


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """What really moved in a synthetic sequence of T frames."""

    theta: NDArray[np.floating]
    """(T, 69) true pose."""
    betas: NDArray[np.floating]
    """(10,) true shape."""
    offsets_m: NDArray[np.float32]
    """(T, V, 3) true offsets in the rest pose, metres."""


@dataclass(frozen=True, eq=False)
class ViewedMotion:
    """One motion that can be chosen."""

    read: Callable[[], Motion]
    """The motion of its own person, y up."""
    of_file: bool = True
    """Whether the root of its file turns about the root joint, wherever a shape has that."""
    truth: str | None = None
    """Name of its sequence in the truth, where that is known."""
    frames: int | None = None
    """How many of its frames the truth has."""


@dataclass(frozen=True, eq=False)
class Repertoire:
    """Everything that one viewer can show; all of it moves the same body model."""

    owner: str
    """Whose predictors they are, for people."""
    origin: str
    """`synthetic` or `licensed`."""
    body: BodyModelData
    body_model: str
    """`embedded:female`, or the path of its file."""
    predictors: Mapping[str, str]
    """Labels by name, the best first."""
    open: Callable[[str], TrainedModel]
    """A predictor by name."""
    takes: Mapping[str, ViewedMotion]
    """By what the picker calls them, the first to be shown first."""
    people: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Shapes (10,) by name, besides each motion's own person."""
    read_truth: Callable[[str], TrueMotion] | None = None
    """The truth of a sequence by name, where any is known."""


def open_repertoire(
    run: Run | None,
    path: Path | None,
    motion_fps: float | None = None,
    smooth_hz: SmoothHz | None = None,
    bony: bool = False,
    how: HowRead = AS_IT_SAYS,
    body_model: str | None = None,
) -> Repertoire:
    """Everything that can be shown with a run's predictors, or with the packaged one.

    Parameters
    ----------
    path : a motion to be shown first, of any format that is read, or a sample.
    bony : its chest follows the file's markers on bone.
    how : what is said of the file besides.
    body_model : of another body than the predictor was trained on; a run's own sequences and
        people are of that one, and are left out.
    """
    given = None
    if path is not None:
        given = load_motion_file(path, motion_fps, smooth_hz=smooth_hz, how=how)
    gender = "unknown" if given is None else given.gender
    best = load_model(run, None, gender, body_model)
    if given is not None:
        given = with_own_shape(given, best.body)
        given = bony_pose(best.body, given) if bony else given
        flesh = [] if bony else flesh_in_pose(given)
        for warning in (*motion_warnings(given, pieces_between_cuts(given.theta)), *flesh):
            notify(warning)
    body, origin = best.body, best.origin

    @cache
    def model(name: str) -> TrainedModel:
        return best if name == best.name else load_model(run, name, gender)

    takes: dict[str, ViewedMotion] = {}
    if given is not None:
        placed = place_motion(given, body)  # refuses what is no person's motion before it is shown
        takes[given.source.stem.removeprefix(SAMPLE_PREFIX)] = ViewedMotion(lambda: placed)
    labels, people = {best.name: best.label}, {AVERAGE: np.zeros(body.shapedirs.shape[-1])}
    found = partial(Repertoire, best.owner, origin, body, best.body_model, open=model)
    if run is None or best.other_body is not None:
        samples = {name: _of_file(Path(SAMPLE_PREFIX + name), body) for name in SAMPLES}
        return found(predictors=labels, takes=takes | samples | takes, people=people)
    known, read = open_truth(run, origin)
    align = run.artifact(ROBUST_ALIGNMENT if run.finished(ROBUST_ALIGNMENT) else ALIGNMENT)
    takes |= _aligned(align, body, known) | _unseen(run, align, body, known)
    if not takes:
        raise DsnetError(f"run {run.name!r} without motions", "a motion", "Pass --motion FILE.")
    return found(
        predictors=labels | _labels_of(run),
        takes=takes,
        people=_people(align) | people,
        read_truth=read if known else None,
    )


def open_truth(run: Run, origin: str) -> tuple[Mapping[str, int], Callable[[str], TrueMotion]]:
    """Lengths of the sequences whose truth is known, by name, and what reads one of them.

    `origin` is that of the run's meshes; the truth is of its own corpus, not of licensed ones.
    """
    known: dict[str, int] = {}
    truth = None
    if origin == "synthetic" and run.finished(TRUTH):
        truth = MotionArrays.of(run.artifact(TRUTH))
        known = {name: place.length for name, place in truth.places.items()}

    def read(name: str) -> TrueMotion:
        if truth is None:
            raise KeyError(name)
        frames = slice(0, known[name])
        offsets_m = np.asarray(truth.offsets_m(name, frames), np.float32)
        return TrueMotion(truth.frames("theta", name, frames), truth.betas(name), offsets_m)

    return known, read


def take_of(moving: MovingBody) -> tuple[ViewedMotion, Callable[[str], TrueMotion] | None]:
    """A motion as it is moved, with its truth if it is one of its run's corpus, as recorded."""
    motion, trained = moving.motion, moving.trained
    first, *_ = trained.artifacts.values()
    folder, take = first.path.parent.resolve(), ViewedMotion(lambda: motion)
    recorded = not set(moving.controls) - {"gain", "part_gain"}
    if recorded and folder / "corpus" in motion.source.resolve().parents:
        known, read = open_truth(Run(folder.name), trained.origin)
        if (name := "_".join(subject_and_motion(motion.source))) in known:
            return replace(take, truth=name, frames=known[name]), read
    return take, None


def _labels_of(run: Run) -> dict[str, str]:
    """Labels of all predictors that move single motions, of every pipeline that the run has."""
    found: dict[str, str] = {}
    for pipeline in PIPELINES:
        if all(run.finished(stage) for stage in pipeline.stages):
            trained = run.artifact(pipeline.stages[0])
            entries = trained.manifest["predictors"]
            found |= {name: entries[name].get("label", name) for name in dsnets_of(trained)}
    return found


def _of_file(path: Path, body: BodyModelData) -> ViewedMotion:
    return ViewedMotion(lambda: place_motion(with_own_shape(load_amass_motion(path), body), body))


def _people(align: Artifact) -> dict[str, NDArray[np.float64]]:
    betas, rows = align.array("betas"), subject_rows(sequences_of(align))
    return {name: betas[row].astype(np.float64) for name, row in rows.items()}


def _aligned(
    align: Artifact, body: BodyModelData, known: Mapping[str, int]
) -> dict[str, ViewedMotion]:
    """The sequences that the run's meshes show, as alignment saw them; those held out first."""
    people, theta = _people(align), align.array("theta")
    takes = {}
    for one in sorted(sequences_of(align), key=lambda one: one.split != "validation"):
        motion = Motion(
            theta=theta[one.frames].astype(np.float64),
            betas=people[one.subject],
            gender=body.gender,
            fps=DEFAULT_FPS,
            source_fps=one.fps,
            source=Path(one.name),
        )
        take = ViewedMotion(lambda motion=motion: motion, of_file=False)
        takes |= _titled(take, one.name, one.split, known)
    return takes


def _unseen(
    run: Run, align: Artifact, body: BodyModelData, known: Mapping[str, int]
) -> dict[str, ViewedMotion]:
    """The corpus's motions without meshes, on which predictors are tested."""
    takes = {}
    if "corpus" in align.manifest["upstream"]:
        corpus = run.artifact("corpus")
        for name in sorted(corpus.manifest["files"]):
            if name.endswith("_poses.npz"):
                path = corpus.file(name)
                sequence = "_".join(subject_and_motion(path))
                takes |= _titled(_of_file(path, body), sequence, "test", known)
    return takes


def _titled(
    take: ViewedMotion, sequence: str, split: str, known: Mapping[str, int]
) -> dict[str, ViewedMotion]:
    """By what the picker calls it, and with its truth."""
    kinds = {"train": "trained on", "validation": "held out", "test": "unseen"}
    if sequence in known:
        take = replace(take, truth=sequence, frames=known[sequence])
    return {f"{sequence} ({kinds[split]})": take}
