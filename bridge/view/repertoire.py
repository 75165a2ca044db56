"""What there is to be seen: motions, people and predictors, of a run or of the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError
from bridge.exchange.trained_dsnet import dsnets_of
from bridge.motion import Motion, load_amass_motion, load_motion_file, sequences_of, subject_rows
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion import DEFAULT_FPS
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.motion_folder import subject_and_motion
from bridge.motion.sample_files import SAMPLE_PREFIX, SAMPLES
from bridge.paper import N_BETAS
from bridge.runs import Artifact, Run
from bridge.runs.processes import notify
from bridge.runs.run import ALIGNMENT, ROBUST_ALIGNMENT
from bridge.runtime.controls import Controls
from bridge.runtime.load_model import PIPELINES, TrainedModel, load_model
from bridge.runtime.moving_body import place_motion
from bridge.view.truth import ReadTruth, open_truth

AVERAGE, AS_ASKED = "average shape", "as asked"


@dataclass(frozen=True, eq=False)
class ViewedMotion:
    """One motion that can be chosen."""

    read: Callable[[NDArray | None], Motion]
    """The motion for a shape (10,), or for that of its own person."""
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
    predictors: Mapping[str, str]
    """Labels by name, the best first."""
    open: Callable[[str], TrainedModel]
    """A predictor by name."""
    takes: Mapping[str, ViewedMotion]
    """By what the picker calls them, the first to be shown first."""
    people: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Shapes (10,) by name, besides each motion's own person."""
    read_truth: ReadTruth | None = None


def open_repertoire(
    run: Run | None, path: Path | None, controls: Controls | None = None
) -> Repertoire:
    """Everything that can be shown with a run's predictors, or with the packaged one.

    Parameters
    ----------
    path : a motion to be shown first: an AMASS `.npz`, a BVH, or a sample such as `sample:walking`.
    controls : a shape that they ask for is one of the people, `AS_ASKED`.

    Raises
    ------
    DsnetError
        If the file is no motion of a body, the run has no trained predictor, or nothing to show,
        or the body has no such shape.
    """
    given = None if path is None else _given(path, controls)
    gender = "unknown" if given is None else given.gender
    best = load_model(run, None, gender)
    named = {} if given is None else {given.source.stem: _of_motion(given, best.body)}
    opened = {best.name: best}

    def character(name: str) -> TrainedModel:
        if name not in opened:
            opened[name] = load_model(run, name, gender)
        return opened[name]

    origin = best.origin
    found = partial(Repertoire, best.owner, origin, best.body, open=character)
    people = _asked(best.body, controls) | {AVERAGE: np.zeros(N_BETAS)}
    if run is None:
        takes = named | _samples(best.body)
        return found(predictors=_labels(best), takes=takes, people=people)
    known, read = open_truth(run, origin)
    align = run.artifact(ROBUST_ALIGNMENT if run.finished(ROBUST_ALIGNMENT) else ALIGNMENT)
    takes = named | _aligned(align, best.body, known) | _unseen(run, align, best.body, known)
    if not takes:
        raise DsnetError(f"run {run.name!r} without motions", "a motion", "Pass --motion FILE.")
    return found(
        predictors=_labels(best) | _labels_of(run),
        takes=takes,
        people=_people(align) | people,
        read_truth=read if known else None,
    )


def _given(path: Path, controls: Controls | None) -> Motion:
    controls = controls or Controls()
    motion = load_motion_file(path, controls.motion_fps, smooth_hz=controls.smooth_hz)
    for warning in motion_warnings(motion, pieces_between_cuts(motion.theta)):
        notify(warning)
    return motion


def _asked(body: BodyModelData, controls: Controls | None) -> dict[str, NDArray[np.float64]]:
    betas = None if controls is None else controls.asked_betas(body)
    return {} if betas is None else {AS_ASKED: betas}


def _labels(best: TrainedModel) -> dict[str, str]:
    return {best.name: best.label}


def _labels_of(run: Run) -> dict[str, str]:
    """Labels of all predictors that move single motions, of every pipeline that the run has."""
    found: dict[str, str] = {}
    for pipeline in PIPELINES:
        if all(run.finished(stage) for stage in pipeline.stages):
            trained = run.artifact(pipeline.stages[0])
            entries = trained.manifest["predictors"]
            found |= {name: entries[name].get("label", name) for name in dsnets_of(trained)}
    return found


def _of_motion(motion: Motion, body: BodyModelData) -> ViewedMotion:
    place_motion(motion, body)  # refuses what is no person's motion before anything is shown
    return ViewedMotion(lambda betas: place_motion(motion, body, betas))


def _of_file(path: Path, body: BodyModelData) -> ViewedMotion:
    load = lru_cache(1)(partial(load_amass_motion, path))
    return ViewedMotion(lambda betas: place_motion(load(), body, betas))


def _with_truth(take: ViewedMotion, sequence: str, known: Mapping[str, int]) -> ViewedMotion:
    return replace(take, truth=sequence, frames=known[sequence]) if sequence in known else take


def _samples(body: BodyModelData) -> dict[str, ViewedMotion]:
    paths = {name: Path(SAMPLE_PREFIX + name) for name in SAMPLES}
    return {name: _of_file(path, body) for name, path in paths.items()}


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
        take = ViewedMotion(partial(_shaped, motion))
        takes[_titled(one.name, one.split)] = _with_truth(take, one.name, known)
    return takes


def _shaped(motion: Motion, betas: NDArray | None) -> Motion:
    return motion if betas is None else replace(motion, betas=betas)


def _unseen(
    run: Run, align: Artifact, body: BodyModelData, known: Mapping[str, int]
) -> dict[str, ViewedMotion]:
    """The corpus's motions without meshes, on which predictors are tested."""
    if "corpus" not in align.manifest["upstream"]:
        return {}
    corpus = run.artifact("corpus")
    takes = {}
    for name in sorted(corpus.manifest["files"]):
        if name.endswith("_poses.npz"):
            path = corpus.file(name)
            subject, motion = subject_and_motion(path)
            sequence = f"{subject}_{motion}"
            take = _of_file(path, body)
            takes[_titled(sequence, "test")] = _with_truth(take, sequence, known)
    return takes


def _titled(sequence: str, split: str) -> str:
    kinds = {"train": "trained on", "validation": "held out", "test": "unseen"}
    return f"{sequence} ({kinds[split]})"
