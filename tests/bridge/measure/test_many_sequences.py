"""What is done for every sequence does not look at all of them: time grows as their number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.measure import alignment_quality, predictions, references
from bridge.measure.alignment_quality import alignment_errors
from bridge.measure.metrics import FrameErrors
from bridge.measure.pooled import PooledCells, PredictorErrors
from bridge.measure.predictions import mean_offsets_m
from bridge.motion import MotionSequence, to_manifest
from bridge.runs import Artifact, write_artifact

BODY = load_body_model("embedded:female")
RNG = np.random.default_rng(0)


def written(path: Path, sequences: int) -> Artifact:
    """Sequences of one frame, three people in turn."""
    index = [
        MotionSequence(f"{row % 3}_walk{row}", str(row % 3), f"walk{row}", row, 1, 60.0)
        for row in range(sequences)
    ]
    arrays = {
        "theta": RNG.normal(0, 0.1, (sequences, 69)).astype(np.float32),
        "betas": RNG.normal(size=(3, 10)).astype(np.float32),
        "offsets": RNG.normal(0, 1e-3, (sequences, BODY.vertex_count, 3)).astype(np.float32),
        "frame_error": np.ones(sequences, np.float32),
    }
    return write_artifact(path, "align", arrays, units=dict.fromkeys(arrays, "1"), data="synthetic",
                          sequences=to_manifest(index))  # fmt: skip


@pytest.fixture
def indexings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How often an index of all sequences is made."""
    made: list[int] = []
    for module in (alignment_quality, predictions, references):
        for name in ("sequences_of", "subject_rows"):
            if (real := getattr(module, name, None)) is not None:

                def counted(of, real=real):
                    made.append(1)
                    return real(of)

                monkeypatch.setattr(module, name, counted)
    return made


@pytest.mark.parametrize("sequences", [3, 9])
def test_the_index_is_made_once_an_artifact(
    sequences: int, tmp_path: Path, indexings: list[int]
) -> None:
    align, truth = (written(tmp_path / name, sequences) for name in ("align", "truth"))
    alignment_errors(align, truth, BODY)
    mean_offsets_m(align)
    assert len(indexings) == 5


def test_the_mean_of_a_person_is_that_of_all_training_frames(tmp_path: Path) -> None:
    align = written(tmp_path / "align", 7)
    means, everybody = mean_offsets_m(align)
    offsets_m = align.array("offsets").astype(np.float64)
    for person in range(3):
        np.testing.assert_allclose(means[str(person)], offsets_m[person::3].mean(axis=0))
    np.testing.assert_allclose(everybody, np.mean(list(means.values()), axis=0))


def test_pooled_errors_are_those_of_all_frames_at_once() -> None:
    """Of a sequence only sums are kept: its histograms alone are 400 kB a predictor."""
    predicted, reference = RNG.normal(0, 1e-2, (2, 6, 2, 5, 3))
    cells, whole = PooledCells(), FrameErrors()
    for found_m, true_m in zip(predicted, reference, strict=True):
        mesh = FrameErrors()
        mesh.add(found_m, true_m)
        cells.add(["test", "new"], {"smpl": PredictorErrors(mesh)})
    whole.add(predicted.reshape(12, 5, 3), reference.reshape(12, 5, 3))
    for cell in ("test", "new"):
        found = cells.summary()[cell]["smpl"]["mesh"]
        spread = found.pop("r2_se")
        assert found == pytest.approx(whole.sums.summary())
        assert 0 < spread < 1
        assert len(cells._pools[cell]["smpl"]._sums) == 1
