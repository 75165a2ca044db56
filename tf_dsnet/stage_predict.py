"""Stage `predict`: latents of the run's own sequences and of motions no network has seen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.exchange.codes import LATENTS_OF
from bridge.exchange.trained_dsnet import code_of
from bridge.motion import MotionSequence, sequences_of, subject_rows, to_manifest
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.motion import Motion
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.motion_folder import PeopleOfFolders, find_motion_files, subject_and_motion
from bridge.motion.resampling import load_motion_file
from bridge.options import PositiveFloat, check_options
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.processes import notify, run_as_process
from bridge.runs.run import body_model_path
from tf_dsnet.trained_predictors import Performance, TrainedPredictors

STAGE = "predict"


@dataclass(frozen=True, kw_only=True)
class AmassOptions:
    """Which motions are predicted beside the run's own sequences."""

    amass: Path | None = None
    """Folder of AMASS files or BVHs in place of the corpus's MoSh-like motions: docs/data.md."""
    amass_fps: PositiveFloat | None = None
    """Frames per second of these files, where what they say of themselves is wrong."""

    def check(self) -> None:
        """Refuse a rate of no files with `DsnetError`, and one that is none."""
        check_options(self)
        if self.amass_fps is not None and self.amass is None:
            raise DsnetError(
                f"--amass-fps {self.amass_fps:g} without --amass",
                "the frame rate of a folder's files",
                "Pass --amass DIR, or leave --amass-fps out.",
            )


@dataclass(frozen=True)
class PredictStageConfig(AmassOptions):
    """Predict the run's sequences at their whole length, then its MoSh-like motions.

    Costs about 0.1 ms a frame. Gives `latents_<name>` of every predictor that the run has trained,
    `theta`, `betas` and the index of the sequences.
    """

    run: str = "demo"
    """Name of the run whose trained network predicts."""
    predictor: str | None = None
    """Which trained predictor the report shows first; the run's own default when left out."""


PROFILES: dict[str, PredictStageConfig] = {
    name: PredictStageConfig(run=name) for name in ("smoke", "demo", "paper")
}


@dataclass(frozen=True, eq=False)
class MotionSet:
    """Sequences with the motions and shapes that the network is given."""

    sequences: list[MotionSequence]
    theta: NDArray[np.float32]
    """(G, 69) all sequences one after another."""
    betas: NDArray[np.float32]
    """(rows, 10) by subject, in order of first appearance."""

    def performances(self) -> Iterator[Performance]:
        """Each sequence with its own motion and shape."""
        rows = subject_rows(self.sequences)
        for one in self.sequences:
            yield Performance(one.start, self.theta[one.frames], self.betas[rows[one.subject]])


def main(config: PredictStageConfig) -> None:
    """Run the stage; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run has no finished `train` or not this predictor, or an AMASS file is not one.
    """
    config.check()
    run = Run(config.run)
    trained, encoded = run.artifact("train"), run.artifact("encode")
    default = config.predictor or trained.manifest["default"]
    # The named one first, so that a name that was never trained is refused before any work.
    names = dict.fromkeys([default, *trained.manifest["predictors"]])
    predictors = TrainedPredictors(trained, tuple(names), partial(body_model_path, run))
    _ = predictors.by_name
    sizes = {name: encoded.array(LATENTS_OF[code_of(trained, name)]).shape[1] for name in names}
    files = find_motions(run, config.amass, encoded)

    def make(writer: ArtifactWriter) -> None:
        motions = gather(encoded, run, files, config.amass_fps)
        writer.put("theta", motions.theta, "rad, then m")
        writer.put("betas", motions.betas, "1")
        frames = len(motions.theta)
        predictors.write(
            motions.performances(),
            {
                name: writer.array_file(
                    f"latents_{name}", (frames, sizes[name]), np.float32, "latent unit"
                )
                for name in names
            },
        )
        writer.record(
            sequences=to_manifest(motions.sequences),
            predictors={name: trained.manifest["predictors"][name]["label"] for name in names},
            codes={name: code_of(trained, name) for name in names},
            default=default,
        )

    upstream = {"train": trained, "encode": encoded}
    upstream |= {f"motion_{index}": path for index, path in enumerate(files)}
    run.build(STAGE, config, make, data=trained.origin, upstream=upstream)


def find_motions(run: Run, amass: Path | None, encoded: Artifact) -> list[Path]:
    """AMASS files to predict: those below `amass`, or those of the run's own corpus, or none."""
    if amass is not None:
        gender = load_body_model(str(body_model_path(run))).gender
        return find_motion_files(amass, gender, [s.name for s in sequences_of(encoded)])
    # A corpus in the run's folder is not its own if licensed meshes were aligned beside it.
    if encoded.origin != "synthetic" or not (run.path / "corpus").is_dir():
        return []
    corpus = run.artifact("corpus")
    names = [name for name in corpus.manifest["files"] if name.startswith("mosh/")]
    return corpus.files(sorted(names))


def gather(
    encoded: Artifact, run: Run, files: Iterable[Path], source_fps: float | None = None
) -> MotionSet:
    """The aligned sequences in their own order, then one test sequence for each file.

    `source_fps` is the rate of all files, where what they say of themselves is wrong.
    """
    sequences = sequences_of(encoded)
    theta = [np.array(encoded.array("theta"))]
    start = len(theta[0])
    betas = np.array(encoded.array("betas"))
    shapes = {subject: betas[row] for subject, row in subject_rows(sequences).items()}
    fitted, people, body = set(shapes), PeopleOfFolders(shapes), None
    for path in files:
        body = body or load_body_model(str(body_model_path(run)))
        subject, name = subject_and_motion(path)
        motion = load_motion_file(path, source_fps)
        pieces, smoothing = pieces_between_cuts(motion.theta), "--smooth-hz auto, with --motion,"
        for warning in motion_warnings(motion, pieces, "--amass-fps", smoothing):
            notify(warning)
        # Those whom the run was aligned with keep the shape that was fitted.
        if subject not in fitted:
            subject = people.of_shape(subject, motion.betas)
        shape = shapes.setdefault(subject, motion.betas)
        motion = motion.about_root_joint(
            (body.J_regressor @ (body.v_template + body.shapedirs @ shape))[0]
        )
        sequences.append(_test_sequence(subject, name, start, motion))
        theta.append(motion.theta)
        start += len(motion.theta)
    rows = [shapes[subject] for subject in subject_rows(sequences)]
    return MotionSet(
        sequences, np.concatenate(theta).astype(np.float32), np.stack(rows).astype(np.float32)
    )


def _test_sequence(subject: str, motion_name: str, start: int, motion: Motion) -> MotionSequence:
    return MotionSequence(
        name=f"{subject}_{motion_name}",
        subject=subject,
        motion=motion_name,
        start=start,
        length=len(motion.theta),
        fps=motion.fps,
        split="test",
    )


if __name__ == "__main__":
    run_as_process(PredictStageConfig, main)
