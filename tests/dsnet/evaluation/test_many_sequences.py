"""What is done for every sequence does not look at all of them: time grows as their number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.motion import MotionSequence
from bridge.runs import Artifact
from dsnet.evaluation import pipelines
from dsnet.evaluation.alignment import alignment_errors
from dsnet.evaluation.pipelines import TEST_SUBJECT, MotionArrays, mean_offsets_m
from tests.forged.artifacts import put

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
    return put(path, arrays, index)


@pytest.fixture
def indexings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How often an index of all sequences is made."""
    made: list[int] = []
    for real in (pipelines.sequences_of, pipelines.shape_rows):

        def counted(*of, real=real):
            made.append(1)
            return real(*of)

        monkeypatch.setattr(pipelines, real.__name__, counted)
    return made


@pytest.mark.parametrize("sequences", [3, 9])
def test_the_index_is_made_once_an_artifact(
    sequences: int, tmp_path: Path, indexings: list[int]
) -> None:
    align, truth = (
        MotionArrays.of(written(tmp_path / name, sequences)) for name in ("align", "truth")
    )
    alignment_errors(align, truth, BODY)
    mean_offsets_m(align)
    assert len(indexings) == 4


def test_the_mean_of_a_person_is_that_of_all_training_frames(tmp_path: Path) -> None:
    align = written(tmp_path / "align", 7)
    means = mean_offsets_m(MotionArrays.of(align))
    offsets_m = align.array("offsets").astype(np.float64)
    for person in range(3):
        np.testing.assert_allclose(means[str(person)], offsets_m[person::3].mean(axis=0))
    everybody = means.pop(TEST_SUBJECT)
    np.testing.assert_allclose(everybody, np.mean(list(means.values()), axis=0))
