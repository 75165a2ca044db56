"""A network of somebody's own moves bodies: predicted, streamed, exported and shown in the page."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import pytest

import dsnet
from bridge.body import load_body_model
from bridge.motion import load_motion
from bridge.runs import Run, read_artifact
from bridge.tissue.trained_plus import NAME
from dsnet.cli import main
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.prediction.moving_body import MovingBody
from dsnet.stream.streams import Stream
from dsnet.view.clip_list import open_clip_list
from dsnet.view.scene import STEP_M, Scene
from tests.dsnet.conftest import WIDTHS, autoencoder_arrays
from tests.dsnet.view.conftest import JUMP, forged_run
from tests.dsnet.view.pages import facts_of, track_m
from tests.forged.codec import write_codec
from tests.forged.encoded import write_encoded
from tests.forged.many_motions import forge
from tests.forged.plugin import use_plugin
from tests.forged.plus import soft_flesh
from tests.pages import python_blocks

pytestmark = pytest.mark.slow
ASKED = ["--run", "r", "--predictor", "gru"]
MOTION = "sample:jumping_jacks"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Run `r`, in which the plug-in that CONTRIBUTING shows was trained beside `dsnet_plus`; the
    plug-in is not there any more."""
    folder = tmp_path_factory.mktemp("own")
    (source,) = [block for block in python_blocks("CONTRIBUTING.md") if "GRU" in block]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DSNET_RUNS", str(folder / "runs"))
        run = forged_run(soft_flesh(load_body_model("embedded:female")))
        write_codec(run.path / "train-ae", autoencoder_arrays(), {"widths": WIDTHS})
        write_encoded(run.path / "encode")
        with pytest.MonkeyPatch.context() as plugged:
            use_plugin(folder, plugged, source)
            searched = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
            command = ["train", "--run", "r", "--epochs", "3", "--predictors", "gru"]
            # TensorFlow has a process of its own, as it does for users.
            done = subprocess.run(
                [sys.executable, "-m", "dsnet.cli", *command],
                env={**os.environ, "PYTHONPATH": searched},
                capture_output=True,
                text=True,
                check=False,
            )
        assert done.returncode == 0, done.stderr
        yield run


@pytest.fixture(scope="module")
def predicted(run: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Offsets, vertices (T, V, 3), metres, and latents (T, 100) of `dsnet predict`."""
    out, write = tmp_path_factory.mktemp("predicted") / "out", "offsets,vertices,latents"
    main(["predict", *ASKED, "--motion", MOTION, "--out", str(out), "--write", write])
    made = read_artifact(out, "prediction")
    assert (made.manifest["predictor"], made.manifest["label"]) == ("gru", "GRU of 96 units")
    return {name: made.array(name) for name in made.manifest["arrays"]}


def test_it_predicts_and_moves(predicted):
    assert np.ptp(predicted["latents"], axis=0).max() > 0.1
    assert np.ptp(predicted["offsets"], axis=0).max() > 1e-4


def test_a_loaded_one_predicts_a_folder_of_motions(run, tmp_path):
    model = dsnet.load_model("r", "gru")
    out = dsnet.predict(forge(tmp_path / "motions", 2), tmp_path / "out", model, body="embedded")
    made = [read_artifact(path.parent) for path in out.rglob("*/manifest.json")]
    assert [one.manifest["predictor"] for one in made] == ["gru"] * 2


def test_it_streams_what_it_predicts(run, predicted):
    bodies = Stream("r", "gru")
    motion = bodies.placed(load_motion(Path(MOTION)))
    who = bodies.join(motion.betas)
    moved = [bodies.step({who: theta})[who] for theta in motion.theta]
    for name, each in (
        ("offsets", [body.offsets_m for body in moved]),
        ("vertices", [body.vertices_m for body in moved]),
    ):
        np.testing.assert_allclose(each, predicted[name], atol=1e-5)


def test_the_exported_graph_gives_what_it_predicts(run, predicted, tmp_path):
    path = tmp_path / "gru.onnx"
    main(["export", "--to", "onnx", *ASKED, "--out", str(path)])
    motion = Stream("r", "gru").placed(load_motion(Path(MOTION)))
    theta, betas = (array.astype(np.float32) for array in (motion.theta, motion.betas))
    found_m = GraphSession(onnx.load_model(path)).rollout(theta[:, None], betas[None])[:, 0]
    np.testing.assert_allclose(found_m, predicted["vertices"], atol=1e-5)


def test_the_page_offers_it_and_shows_its_offsets(run):
    clip_list = open_clip_list(run, None)
    assert [*clip_list.predictors] == [NAME, "gru"]
    scene = Scene(clip_list)
    shown = facts_of(scene)
    assert shown["labels"]["gru"] == "GRU of 96 units"
    number = [one["name"] for one in shown["motions"]].index(JUMP)
    found_m = track_m(scene.assets[f"track{number}_gru"]())
    motion = clip_list.clips[JUMP].read().frames(slice(len(found_m)))
    moving = MovingBody(clip_list.open("gru"), motion)
    expected_m = np.concatenate([piece.offsets_m for piece in moving])
    np.testing.assert_allclose(found_m, expected_m, atol=0.51 * STEP_M)
    assert np.ptp(expected_m, axis=0).max() > 1e-4
