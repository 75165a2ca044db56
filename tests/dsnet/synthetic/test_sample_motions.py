"""The packaged motions are what the tool in the tree makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.motion.readers.amass import SAMPLES, sample_path
from tools import build_sample_motions


def test_the_tool_makes_them_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_sample_motions, "sample_path", lambda name: tmp_path / f"{name}.npz")
    build_sample_motions.main()
    for name in SAMPLES:
        with np.load(tmp_path / f"{name}.npz") as made, np.load(sample_path(name)) as kept:
            assert sorted(made) == sorted(kept)
            for key in ("poses", "trans", "betas"):
                np.testing.assert_allclose(made[key], kept[key], atol=1e-6)
