"""A rival's offsets on a run's test clips, measured by what measures every other system."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.prediction.comparison_scores import short, sizes_over_time
from benchmarks.prediction.corpora import scores_of
from benchmarks.rivals.rival import MotionClip, Rival
from bridge.body import BodyModelData
from bridge.motion import MotionSequence, sequences_of, subject_rows, to_manifest
from bridge.motion.sequences import end_to_end
from bridge.runs import Artifact, ArtifactWriter
from dsnet.evaluation.evaluation import evaluate_pipelines
from dsnet.evaluation.pipelines import BEST, MotionArrays, Pipeline


def validation_clips(align: Artifact) -> list[MotionClip]:
    """The clips that other systems choose their rates and epochs by, as they were aligned."""
    rows, betas = subject_rows(sequences_of(align)), align.array("betas")
    return [
        MotionClip(
            betas=np.array(betas[rows[one.subject]]),
            theta=np.array(align.array("theta")[one.frames]),
            fps=one.fps,
            offsets_m=align.array("offsets")[one.frames],
        )
        for one in sequences_of(align)
        if one.split == "validation"
    ]


def score_rival(
    rival: Rival, motions: Artifact, align: Artifact, truth: Artifact, body: BodyModelData
) -> dict[str, Any]:
    """Cells, sequences, labels and sizes over time, as the comparison keeps them.

    Parameters
    ----------
    rival : with its settings chosen.
    motions : `theta` and `betas` that predictors were given, `infer_plus`.
    """
    with tempfile.TemporaryDirectory() as folder:
        offsets = _predict(Path(folder) / "offsets", rival, motions, body)
        predicted = MotionArrays.of(offsets)
        pipeline = Pipeline(BEST, MotionArrays.of(align), predicted, predicted)
        writer = ArtifactWriter(Path(folder) / "evaluate", "evaluate", data=align.origin)
        evaluate_pipelines(writer, [pipeline], truth, body)
        evaluated = writer.finish()
        found = short(scores_of(evaluated))
        return found | {"over_time": sizes_over_time(evaluated)}


def _predict(path: Path, rival: Rival, motions: Artifact, body: BodyModelData) -> Artifact:
    """Offsets of the test clips, as a stage would leave them."""
    chosen = [one for one in sequences_of(motions) if one.split == "test"]
    placed, given = end_to_end(chosen), MotionArrays.of(motions)
    writer = ArtifactWriter(path, "rival", data=motions.origin)
    frames = sum(one.length for one in placed)
    offsets = writer.array_file(
        f"offsets_{rival.name}", (frames, len(body.v_template), 3), np.float32, "m"
    )
    for one in tqdm(placed, desc=rival.name, unit="sequence", disable=None):
        theta = given.frames("theta", one.name, slice(0, one.length))
        offsets.write(one.start, rival.offsets_m(given.betas(one.name), theta, one.fps))
    _put_motions(writer, chosen, given)
    writer.record(
        sequences=to_manifest(placed), predictors={rival.name: rival.label}, default=rival.name
    )
    return writer.finish()


def _put_motions(writer: ArtifactWriter, chosen: list[MotionSequence], given: MotionArrays) -> None:
    theta = [given.frames("theta", one.name, slice(0, one.length)) for one in chosen]
    of_subject = {one.subject: given.betas(one.name) for one in chosen}
    writer.put("theta", np.concatenate(theta), "rad, then m")
    writer.put("betas", np.stack([of_subject[subject] for subject in subject_rows(chosen)]), "1")
