"""The absorption figures are drawn whole, with as many curves, bars and bodies as aligners."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchmarks.alignment import absorption_figures
from benchmarks.alignment.absorption_figures import (
    Drawn,
    draw_absorption,
    draw_error_bodies,
)
from bridge.body import load_body_model
from dsnet.evaluation.alignment import Absorption

ONE, OTHER = Drawn("one", "#D55E00"), Drawn("other", "#0072B2", "--")


@pytest.fixture
def drawn(monkeypatch) -> list[Figure]:
    """The figures that are saved."""
    figures: list[Figure] = []
    save = absorption_figures.save_figure
    monkeypatch.setattr(
        absorption_figures,
        "save_figure",
        lambda figure, path: (figures.append(figure), save(figure, path)),
    )
    return figures


def test_bars_show_the_parts_that_move(tmp_path, drawn):
    body = load_body_model("embedded:female")
    true = np.zeros((2, 6890, 3))
    belly = np.isin(body.weights.argmax(axis=1), [0, 3])  # pelvis and spine1
    true[:, belly] = 0.01
    half, none = Absorption(body), Absorption(body)
    half.add(0.5 * true, true)
    none.add(true, true)
    summaries = {ONE: half.summary(), OTHER: none.summary()}
    draw_absorption(tmp_path / "bars.png", summaries, title="any", origin="synthetic")
    absorbed = drawn[0].get_axes()[0]
    widths = [bar.get_width() for bars in absorbed.containers for bar in bars]  # type: ignore
    np.testing.assert_allclose(widths, [50, 50, 0, 0], atol=1e-9)


def test_bodies_are_drawn_from_both_sides(tmp_path):
    body = load_body_model("embedded:female")
    rms_m = 0.01 * np.abs(body.v_template[:, 2])
    draw_error_bodies(
        tmp_path / "bodies.png",
        body.v_template,
        body.faces,
        rms_m,
        {ONE: 0.5 * rms_m},
        title="any",
        origin="synthetic",
        panel_px=48,
    )
    assert (tmp_path / "bodies.png").stat().st_size > 5_000
