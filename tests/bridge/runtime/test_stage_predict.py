"""One motion for the run's body: whose betas they are is said when they are not its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.runs import Run
from bridge.runtime import stage_predict as predict
from tests.forged.amass import save, smplh


@pytest.mark.parametrize(
    ("gender", "betas", "said"),
    [
        ("male", None, "are a male's, the body female: see --betas\n"),
        ("male", ",".join("0" * 10), ""),
        ("neutral", None, ""),
        ("female", None, ""),
    ],
)
def test_betas_of_the_other_gender_are_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    gender: str,
    betas: str | None,
    said: str,
) -> None:
    monkeypatch.setattr(predict, "body_model_path", lambda run: "embedded:female")
    path = save(tmp_path / "a_poses.npz", smplh(), gender=gender)
    motion = predict._load(Run("any"), path, betas)
    printed = capsys.readouterr().err
    assert printed.endswith(said)
    assert printed.count("\n") == bool(said)
    expected = np.zeros(10) if betas else smplh()["betas"][:10]
    np.testing.assert_array_equal(motion.betas, expected)
