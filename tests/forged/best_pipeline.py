"""What the best pipeline's stages leave beside a forged run of the paper's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.motion.splits import decoded_sequences
from bridge.runs import ArtifactWriter, read_artifact
from tests.forged.artifacts import put

PLUS = "dsnet_plus"
LABEL = "DSNet plus"


def write_best_pipeline(
    run: Path, *, share: float = 0.9, static_share: float | None = None, own_alignment: bool = True
) -> None:
    """Add `align_robust`, `train_plus` and `infer_plus` to a forged run.

    Parameters
    ----------
    share : how much of the true moving offsets is predicted.
    static_share : how much of the true static part is predicted; None for a model without one.
    own_alignment : whether the pipeline has an `align_robust`; else `align` is its alignment.
    """
    truth, align = read_artifact(run / "truth"), read_artifact(run / "align")
    alignment = "align_robust" if own_alignment else "align"
    if own_alignment:
        _write_alignment(run, sequences_of(align))
    best = read_artifact(run / alignment)
    train = ArtifactWriter(run / "train_plus", "train_plus", data="synthetic")
    train.put(f"loss_{PLUS}", np.geomspace(1.0, 0.1, 30).astype(np.float32), "1")
    train.record(predictors={PLUS: {"label": LABEL, "departures": ["no autoencoder"]}})
    trained = train.finish(config={"seed": 0}, upstream={alignment: best.content_sha256})
    _write_predictions(
        run, share, static_share, {"train_plus": trained.content_sha256,
                                   alignment: best.content_sha256}, best.array("betas"),
        sequences_of(truth), sequences_of(best),
    )  # fmt: skip


def _write_alignment(run: Path, aligned: list[MotionSequence]) -> None:
    """The truth itself but for a tenth of a millimetre."""
    truth = read_artifact(run / "truth")
    rows, frames = subject_rows(sequences_of(truth)), sum(s.length for s in aligned)
    own = [rows[subject] for subject in subject_rows(aligned)]
    arrays = {
        "theta": np.asarray(truth.array("theta")[:frames]),
        "betas": np.asarray(truth.array("betas")[own]),
        "offsets": np.asarray(truth.array("offsets")[:frames]) + np.float32(1e-4),
        "frame_error": np.full(frames, 0.001, np.float32),
    }
    put(run / "align_robust", arrays, aligned, config={"aligner": "robust", "smpl": None})


def _write_predictions(
    run: Path,
    share: float,
    static_share: float | None,
    upstream: dict[str, str],
    fitted_betas: NDArray,
    index: list[MotionSequence],
    aligned: list[MotionSequence],
) -> None:
    """Shares of the true offsets, with the fitted shapes of those who have one."""
    truth = read_artifact(run / "truth")
    decoded, start, sequences, rows = decoded_sequences(index), 0, [], []
    for place in decoded:
        sequences.append(MotionSequence(**{**vars(place), "start": start}))
        rows.append(np.arange(place.start, place.start + place.length))
        start += place.length
    frames = np.concatenate(rows)
    fitted, true = subject_rows(aligned), subject_rows(index)
    betas = [
        fitted_betas[fitted[subject]] if subject in fitted else truth.array("betas")[true[subject]]
        for subject in subject_rows(sequences)
    ]
    offsets_m = np.float32(share) * truth.array("offsets")[frames]
    arrays = {"theta": truth.array("theta")[frames], "betas": np.stack(betas)}
    if static_share is not None:
        arrays[f"static_{PLUS}"] = np.float32(static_share) * truth.array("static")[frames]
        offsets_m = offsets_m + arrays[f"static_{PLUS}"]
    arrays[f"offsets_{PLUS}"] = offsets_m
    told = {"predictors": {PLUS: LABEL}, "config": {}, "upstream": upstream}
    put(run / "infer_plus", arrays, sequences, **told)
