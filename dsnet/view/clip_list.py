"""The clips, shapes and predictors that the viewer offers: those of a run, or of the package.

The simulated truth is shown beside predictions, and only errors are computed from it. Apart from
evaluation and the report this is the only module that reads it, and no predictor receives it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notices, notify
from bridge.exchange.dsnet import dsnets_of
from bridge.motion import Motion, MotionSequence, load_motion, sequences_of, subject_shapes
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

_AVERAGE = "average shape"
TRUTH = "truth"
READING = ("up", "motion_fps", "smooth_hz", "floor", "person", "pose", "gender", "body")
"""Fields of `Controls` that say how a file is read, and which body performs it."""
_SPLIT_LABELS = {"train": "trained on", "validation": "held out", "test": "unseen"}


@dataclass(frozen=True, eq=False)
class Clip:
    """One motion that can be chosen in the viewer."""

    read: Callable[[], Motion]
    """Loads the motion, with the betas of its subject, y up."""
    sequence: str = ""
    """Name of the run's sequence, by which the truth is looked up; empty if it has none."""
    path: Path | None = None
    """Its motion file or sample; None of a run's aligned sequence, which has none."""
    controls: Controls = field(default_factory=Controls)
    """How that file is read."""
    told: tuple[str, ...] | None = None
    """What is told of the motion, a line each; None: `motion_warnings` of what is shown."""

    @property
    def reading(self) -> dict[str, str] | None:
        """Of `READING` what is not left at its default; None of what is no file."""
        given = self.controls.given() | ({"body": self.controls.body} if self.controls.body else {})
        words = {name: str(given[name]) for name in READING if name in given}
        return words if self.path else None


@dataclass(frozen=True, eq=False)
class ClipList:
    """Everything that one viewer can show; all clips move the same body model."""

    best: TrainedModel
    """The predictor that is shown first; its body is the one that moves."""
    predictors: Mapping[str, str]
    """Labels of predictors by name, the best first."""
    open: Callable[[str], TrainedModel]
    """Loads a predictor by name."""
    clips: Mapping[str, Clip]
    """Clips by their title in the page; the first one is shown first."""
    shapes: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Betas (10,) by name, which can be chosen instead of those of the motion."""
    truth: MotionArrays | None = None
    """True poses, shapes and offsets; None if they are not known."""

    def truth_of(self, clip: Clip) -> MotionSequence | None:
        """The true sequence of a clip; None if it has none."""
        return self.truth.sequences.get(clip.sequence) if self.truth else None


def open_clip_list(
    run: Run | None, path: Path | None, controls: Controls | None = None
) -> ClipList:
    """Everything that can be shown with a run's predictors, or with the packaged one.

    Parameters
    ----------
    path : motion file of any supported format, or a sample, that is shown first.
    controls : how that file is read and posed, and on which body. On another body than the
        predictor was trained on, the run's own sequences and subjects are left out.
    """
    controls = controls or Controls()
    if path is None:
        return clip_list_of(run, controls.model(run, None), {}, controls)
    best, clip = open_file(run, path, controls)
    for line in clip.told or ():
        notify(line)
    return clip_list_of(run, best, {path_title(path): clip}, controls)


def open_file(
    run: Run | None,
    path: Path,
    controls: Controls,
    rate_option: str = "--motion-fps",
    smooth_option: str = "--smooth-hz auto",
) -> tuple[TrainedModel, Clip]:
    """The clip of a motion file or a sample, and the predictor on the body that performs it.

    `rate_option` and `smooth_option` are what warnings advise, see `motion_warnings`.
    """
    with notices() as told:
        best, motion = controls.load(run, None, path)
        moving = controlled_body(best, motion, controls)
    told += motion_warnings(moving.motion, moving.pieces, rate_option, smooth_option)
    told += [] if controls.pose == "bony" else flesh_in_pose(motion)
    clip = Clip(lambda: moving.motion, path=path, controls=controls, told=tuple(told))
    return best, clip


def clip_list_of(
    run: Run | None, best: TrainedModel, clips: Mapping[str, Clip], controls: Controls
) -> ClipList:
    """`clips` first, then what else the same body can show."""
    clips = dict(clips)
    model = cache(lambda name: best if name == best.name else load_model(run, name))
    shapes = {_AVERAGE: np.zeros(best.body.shapedirs.shape[-1])}
    clip_list = ClipList(best, {best.name: best.label}, model, clips, shapes)
    if run is None or best.other_body is not None:
        paths = [Path(SAMPLE_PREFIX + name) for name in SAMPLES]
        # Samples name no gender, and without one a woman performs them.
        gender = "male" if best.body.gender == "male" else controls.gender
        asked = Controls(body=controls.body, gender=gender)
        samples = {path_title(one): _of_file(one, best.body, controls=asked) for one in paths}
        return replace(clip_list, clips=clips | samples | clips)
    align = run.artifact(ROBUST_ALIGNMENT if run.finished(ROBUST_ALIGNMENT) else ALIGNMENT)
    for clip, split in _recorded(run, align, best.body):
        clips[f"{clip.sequence} ({_SPLIT_LABELS[split]})"] = clip
    if not clips:
        raise DsnetError(f"run {run.name!r} without motions", "a motion", "Pass --motion FILE.")
    return replace(
        clip_list,
        predictors={**clip_list.predictors, **_dsnets_of(run)},
        shapes=_subject_betas(align) | shapes,
        truth=open_truth(run, best.origin),
    )


def path_title(path: Path) -> str:
    """The title of a file or a sample in the page."""
    return path.stem.removeprefix(SAMPLE_PREFIX)


def open_truth(run: Run, origin: str) -> MotionArrays | None:
    """The simulated truth of a run's sequences; None if there is none.

    `origin` is that of the run's meshes: of licensed ones no truth is known.
    """
    has_truth = origin == "synthetic" and run.finished(TRUTH)
    return MotionArrays.of(run.artifact(TRUTH)) if has_truth else None


def clip_of(moving: MovingBody) -> tuple[Clip, MotionArrays | None]:
    """The clip of a moving body, and the truth if it is an unchanged motion of its run."""
    motion, trained = moving.motion, moving.trained
    first, *_ = trained.artifacts.values()
    folder, clip = first.path.parent.resolve(), Clip(lambda: motion)
    unchanged = not set(moving.controls) - {"gain", "part_gain"}
    if unchanged and folder / "corpus" in motion.source.resolve().parents:
        sequence = "_".join(subject_and_motion(motion.source))
        return replace(clip, sequence=sequence), open_truth(Run(folder.name), trained.origin)
    return clip, None


def _dsnets_of(run: Run) -> dict[str, str]:
    """Labels of the run's DSNets by name; empty if stages that they need are not finished."""
    stages = next(stages for stages in PIPELINES if TRAIN in stages)
    if not all(map(run.finished, stages)):
        return {}
    trained = run.artifact(TRAIN)
    entries = trained.manifest["predictors"]
    return {name: entries[name].get("label", name) for name in dsnets_of(trained)}


def _of_file(
    path: Path, body: BodyModelData, sequence: str = "", controls: Controls | None = None
) -> Clip:
    def read() -> Motion:
        motion = load_motion(path, how=HowRead(up="z"))
        return place_motion(with_betas_on(motion, body), body)

    return Clip(read, sequence, path, controls or Controls())


def _subject_betas(align: Artifact) -> dict[str, NDArray[np.float64]]:
    shapes = subject_shapes(sequences_of(align), align.array("betas"))
    return {subject: betas.astype(np.float64) for subject, betas in shapes.items()}


def _recorded(run: Run, align: Artifact, body: BodyModelData) -> Iterator[tuple[Clip, str]]:
    """Clips of a run's sequences, each with its split.

    First the aligned ones, those held out before the others; then the corpus's motions without
    meshes, on which predictors are tested.
    """
    betas, theta = _subject_betas(align), align.array("theta")
    for one in sorted(sequences_of(align), key=lambda one: one.split != "validation"):
        motion = Motion(
            theta=theta[one.frames].astype(np.float64),
            betas=betas[one.subject],
            gender=body.gender,
            fps=FPS,
            source_fps=one.fps,
            source=Path(one.name),
            trans_of="y",  # the translation holds for any shape
        )
        yield Clip(lambda motion=motion: motion, one.name), one.split
    if "corpus" in align.manifest["upstream"]:
        corpus = run.artifact("corpus")
        for name in sorted(corpus.manifest["files"]):
            if name.endswith("_poses.npz"):
                path = corpus.file(name)
                yield _of_file(path, body, "_".join(subject_and_motion(path))), "test"
