"""Pictures that show a run's predictors beside its truth, of a real run."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from tools.build_gallery import Gallery, recorded_motion
from tools.gallery.stills import Look

pytestmark = pytest.mark.slow


def test_a_recorded_motion_by_a_runs_predictors(smoke_runs, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(smoke_runs))
    config = Gallery(run="smoke", look=Look(body_px=90))
    path, file = tmp_path / "a.gif", Path("sample:jumping_jacks")
    recorded_motion(config, path, file, slice(30, 42), person_of="side_to_side_hopping")
    with Image.open(path) as clip:
        assert (getattr(clip, "n_frames", 1), clip.size[0]) == (4, 3 * 76 + 62)
        comment = clip.info["comment"].decode()
    assert "dsnet_standardised, dsnet_plus of run 'smoke'" in comment
    assert '"floor": "shift"' in comment
    assert '"smooth_hz": "auto"' in comment
