"""Whole clips in one call of ONNX Runtime are what `dsnet predict` gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnxruntime
import pytest

import dsnet
from dsnet.cli import main
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.verify import draws
from tests.forged.codec import papers_model

BETAS = np.array([np.zeros(10), np.linspace(-1, 1, 10)], np.float32)
FRAMES = 40


def test_clips_of_two_bodies_are_their_predictions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["export", "--to", "onnx-clip", "--out", str(tmp_path / "clip.onnx")])
    assert "wrote" in capsys.readouterr().err
    session = onnxruntime.InferenceSession(tmp_path / "clip.onnx")
    about = session.get_modelmeta().custom_metadata_map
    assert about["data"] == "synthetic"
    assert "state" not in about
    walk = dsnet.load_motion("sample:walking").theta[:FRAMES].astype(np.float32)
    names = ["vertices", "offsets"]
    given = {"theta": walk[:, None].repeat(2, axis=1), "betas": BETAS}
    found = dict(zip(names, map(np.asarray, session.run(names, given)), strict=True))
    assert found["vertices"].shape == found["offsets"].shape == (FRAMES, 2, 6890, 3)
    trained = dsnet.load_model("female").model
    whole_m = GraphSession(trained.graph({}, "float32")).rollout(
        np.concatenate([given["theta"], *[given["theta"][-1:]] * trained.look_ahead]), BETAS
    )
    np.testing.assert_allclose(found["vertices"], whole_m[trained.look_ahead :], atol=1e-6)
    for person, betas in enumerate(BETAS):
        _, offsets_m = dsnet.animate("sample:walking", betas=betas.tolist()).arrays()
        ends = FRAMES - trained.look_ahead  # the whole sample goes on
        np.testing.assert_allclose(found["offsets"][:ends, person], offsets_m[:ends], atol=1e-6)
        assert np.abs(found["offsets"][:, person]).max() > 1e-3


def test_clips_of_the_papers_network_are_its_steps(tmp_path: Path) -> None:
    model = papers_model(tmp_path / "train-ae")
    given = draws.stream(3, 5, 2)
    inputs = {name: given[name] for name in ("theta", "betas")}
    found = GraphSession(model.clip_graph({}))(**inputs)
    expected_m = GraphSession(model.graph({}, "float32")).rollout(**inputs)
    np.testing.assert_allclose(found["vertices"], expected_m, atol=1e-6)
    assert found["offsets"].shape == (5, 2, 6890, 3)
