"""The part of stage `infer` that `dsnet_plus` has: offsets of sequences and unseen motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bridge.body import BodyModelData, load_body_model
from bridge.motion import MotionSequence, subject_rows, to_manifest
from bridge.motion.cuts import predict_between_cuts
from bridge.motion.sequences import end_to_end
from bridge.motion.splits import decoded_sequences
from bridge.runs import ArtifactWriter, Run
from bridge.runs.progress import progress
from bridge.runs.run import INFER_PLUS, TRAIN_PLUS, best_alignment, body_model_path
from bridge.runs.worker_pool import on_any_node, worker_pool
from bridge.runtime.run_motions import AmassOptions, MotionSet, find_motions, gather
from bridge.runtime.stepping import PlusModel, codes_of
from bridge.tissue.trained_plus import NAME, TrainedPlus


@dataclass(frozen=True)
class InferPlusConfig(AmassOptions):
    """Predict offsets of the evaluated sequences: about 1 ms a frame, 1 GB.

    Gives `offsets_dsnet_plus`, `static_dsnet_plus` where the model has a static part, `theta`,
    `betas` and the index of the sequences.
    """

    run: str = "demo"
    """Run whose `dsnet_plus` predicts."""


def main(config: InferPlusConfig) -> None:
    """Run the stage; a result that is current is kept.

    Raises
    ------
    DsnetError
        If the run has no finished `train_plus`, or an AMASS file is not one.
    """
    config.check()
    run = Run(config.run)
    trained, align = run.artifact(TRAIN_PLUS), best_alignment(run)
    body = load_body_model(str(body_model_path(run)))
    files = find_motions(run, config.amass, align)

    def make(writer: ArtifactWriter) -> None:
        model = PlusModel(TrainedPlus.load(trained), body)
        _write(writer, model, body, gather(align, run, files, config.amass_fps))
        labels = {name: one["label"] for name, one in trained.manifest["predictors"].items()}
        writer.record(predictors=labels, default=trained.manifest["default"])

    upstream = {TRAIN_PLUS: trained, align.path.name: align}
    upstream |= {f"motion_{index}": path for index, path in enumerate(files)}
    run.build(INFER_PLUS, config, make, data=align.origin, upstream=upstream)


def _write(
    writer: ArtifactWriter, model: PlusModel, body: BodyModelData, motions: MotionSet
) -> None:
    chosen = decoded_sequences(motions.sequences)
    placed = end_to_end(chosen)
    rows = subject_rows(chosen)
    of_all = subject_rows(motions.sequences)
    betas = {subject: motions.betas[of_all[subject]] for subject in rows}
    size = (sum(s.length for s in placed), body.vertex_count, 3)
    total = writer.array_file(f"offsets_{NAME}", size, np.float32, "m")
    has_static = bool(model.trained.static)
    static = writer.array_file(f"static_{NAME}", size, np.float32, "m") if has_static else None

    def predict(model: PlusModel, pair: tuple[MotionSequence, MotionSequence]) -> None:
        sequence, place = pair
        shape, theta = betas[sequence.subject], motions.theta[sequence.frames]
        at_nodes = predict_between_cuts(
            lambda part: np.stack([*codes_of(model, part, shape)]).transpose(0, 2, 1), theta
        )
        for rows in place.pieces():
            own = slice(rows.start - place.start, rows.stop - place.start)
            total_m = model.trained.nodes.spread(at_nodes[own])
            static_m = model.trained.static_m(body, shape, theta[own])
            if static is not None and static_m is not None:
                total_m += static_m
                static.write(rows.start, static_m)
            total.write(rows.start, total_m)

    pairs = list(zip(chosen, placed, strict=True))
    with worker_pool(on_any_node("threads"), model) as pool:
        done = pool.map(predict, pairs)
        for _ in progress(done, what=NAME, unit="sequence", total=len(pairs)):
            pass
    theta = np.concatenate([motions.theta[sequence.frames] for sequence in chosen])
    writer.put("theta", theta, "rad, then m")
    writer.put("betas", np.stack([betas[subject] for subject in rows]), "1")
    writer.record(sequences=to_manifest(placed))
