"""Pictures that show a run's predictors beside its truth, of a real run."""

from __future__ import annotations

import pytest
from PIL import Image

from tools.build_gallery import Gallery, gravity, landing
from tools.gallery.stills import Look

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("make", [landing, gravity])
def test_a_runs_bodies_beside_the_truth(smoke_runs, tmp_path, monkeypatch, make):
    monkeypatch.setenv("DSNET_RUNS", str(smoke_runs))
    config = Gallery(run="smoke", look=Look(width_px=120, samples=1))
    make(config, tmp_path / "a.png", kind="side_to_side_hopping")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size[0] > 1000
