"""The pictures of skin are what their painter paints."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from bridge.body.embedded import EMBEDDED_GENDERS
from tools.paint_skin import ASSETS, paint, save

pytest.importorskip("embreex")


@pytest.mark.slow
@pytest.mark.parametrize("gender", EMBEDDED_GENDERS)
def test_the_painter_paints_what_ships(tmp_path, gender):
    """Pixel by pixel; other processors round some rays otherwise, and shift a shade by a step."""
    save(paint(gender), tmp_path / "again.png")
    again, ships = (
        np.asarray(Image.open(path).convert("RGB"), int)
        for path in (tmp_path / "again.png", ASSETS / f"embedded_skin_{gender}.png")
    )
    assert again.shape == ships.shape
    assert (again != ships).any(axis=-1).mean() < 0.001
