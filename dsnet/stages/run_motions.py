"""Which motions a run's predictors predict: its own sequences, then motions nobody trained on."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_paper_body
from bridge.errors import notify
from bridge.motion import (
    MotionSequence,
    sequences_of,
    shape_rows,
    subject_rows,
    subject_shapes,
)
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.readers import PeopleOfFolders, find_motion_files, subject_and_motion
from bridge.motion.resampling import load_motion
from bridge.motion.splits import take_suffix
from bridge.runs import Artifact, Run
from bridge.runs.run import body_model_path
from dsnet.prediction.shape_space import with_betas_on


@dataclass(frozen=True, eq=False)
class MotionSet:
    """Sequences with the motions and shapes that predictors are given."""

    sequences: list[MotionSequence]
    theta: NDArray[np.float32]
    """(G, 69) all sequences one after another."""
    betas: NDArray[np.float32]
    """(rows, 10) by subject, in order of first appearance, or one of each sequence if that is what
    was aligned."""


def find_motions(
    run: Run, amass: Path | None, encoded: Artifact, listed: Path | None = None
) -> list[Path]:
    """AMASS files to predict: those below `amass`, or of these those that the file `listed` names;
    or those of the run's own corpus, or none."""
    if amass is not None:
        gender = load_paper_body(str(body_model_path(run))).gender
        return find_motion_files(amass, gender, [s.name for s in sequences_of(encoded)], listed)
    # A corpus in the run's folder is not its own if licensed meshes were aligned beside it.
    if encoded.origin != "synthetic" or not (run.path / "corpus").is_dir():
        return []
    corpus = run.artifact("corpus")
    names = [name for name in corpus.manifest["files"] if name.startswith("mosh/")]
    return [corpus.file(name) for name in sorted(names)]


def gather(
    encoded: Artifact, run: Run, files: Iterable[Path], source_fps: float | None = None
) -> MotionSet:
    """The aligned sequences in their own order, then one test sequence for each file.

    `source_fps` is the rate of all files, where what they say of themselves is wrong. Whose file it
    is, its betas tell; the shape is that of its person on the run's body.
    """
    sequences = sequences_of(encoded)
    theta = [np.array(encoded.array("theta"))]
    start = len(theta[0])
    betas = np.array(encoded.array("betas"))
    aligned, shapes = shape_rows(sequences, betas), subject_shapes(sequences, betas)
    shape_of_each = len(betas) > len(shapes)
    fitted, stated, body = set(shapes), {**shapes}, None
    people, used = PeopleOfFolders(stated), {one.name for one in sequences}
    for path in files:
        body = body or load_paper_body(str(body_model_path(run)))
        subject, name = subject_and_motion(path)
        motion = load_motion(path, source_fps)
        smoothing = "`dsnet predict --smooth-hz auto`"
        for warning in motion_warnings(motion, None, "--amass-fps", smoothing):
            notify(warning)
        # Those whom the run was aligned with keep the shape that was fitted.
        if subject not in fitted:
            subject = people.of_shape(subject, motion.betas)
        if subject not in shapes:
            stated[subject], shapes[subject] = motion.betas, with_betas_on(motion, body).betas
        shape = shapes[subject]
        motion = motion.about_root_joint(
            (body.J_regressor @ (body.v_template + body.shapedirs @ shape))[0]
        )
        length, name = len(motion.theta), _further_take(subject, name.replace(" ", "_"), used)
        sequences.append(
            MotionSequence(f"{subject}_{name}", subject, name, start, length, motion.fps, "test")
        )
        used.add(sequences[-1].name)
        theta.append(motion.theta)
        start += length
    if shape_of_each:  # a new take of a known person has the mean of what was fitted
        rows = [
            betas[aligned[one.name]] if one.name in aligned else shapes[one.subject]
            for one in sequences
        ]
    else:
        rows = [shapes[subject] for subject in subject_rows(sequences)]
    return MotionSet(
        sequences, np.concatenate(theta).astype(np.float32), np.stack(rows).astype(np.float32)
    )


def _further_take(subject: str, motion: str, used: Collection[str]) -> str:
    """A motion's name: MoSh's `hips` is a second take where Dyna's `50004_hips` was aligned."""
    takes = itertools.chain([motion], (motion + take_suffix(take) for take in itertools.count(2)))
    return next(name for name in takes if f"{subject}_{name}" not in used)
