"""One motion to files: what is written, where, and who else is there."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import load_body_model, pose_vertices
from bridge.exchange.dsnet import join_inputs
from bridge.motion import load_motion, unpack_theta
from bridge.runs import read_artifact, write_artifact
from dsnet.cli import main
from dsnet.prediction.controls import Controls
from dsnet.prediction.moving_body import place_motion
from dsnet.prediction.prediction_files import KIND, predict_motion
from dsnet.verify.reference import dsnet, mesh_autoencoder
from tests.dsnet.conftest import autoencoder_arrays
from tests.forged.amass import save, smplh


@pytest.mark.usefixtures("blank_strip")
def test_vertices_are_the_references(trained_run, trained, tmp_path):
    """DSNet, decoder and SMPL once more, each by its float64 reference."""
    rng = np.random.default_rng(1)
    changes = {"poses": rng.normal(0, 0.2, (51, 156)), "trans": rng.normal(0, 0.05, (51, 3))}
    path = save(tmp_path / "a_poses.npz", smplh(51, 100.0) | {"source": "synthetic"}, **changes)
    made = predict_motion(trained_run, path, tmp_path / "out")
    made.verify()

    body = load_body_model("embedded:female")
    motion = place_motion(load_motion(path), body)
    wide = {name: array.astype(np.float64) for name, array in trained.weights.items()}
    inputs = join_inputs(motion.theta, motion.betas)
    scaled = (inputs - trained.scaling.input_mean) / trained.scaling.input_std
    outputs = dsnet.predict(wide, scaled[None])["fc_enc_3"][0]
    latents = outputs * trained.scaling.latent_std + trained.scaling.latent_mean
    np.testing.assert_allclose(made.array("latents"), latents, atol=1e-4)

    w = {n.removeprefix("model."): a.astype(np.float64) for n, a in autoencoder_arrays().items()}
    offsets = mesh_autoencoder.decode(w, latents)
    np.testing.assert_allclose(made.array("offsets"), offsets, atol=1e-5)
    betas = np.tile(motion.betas, (len(offsets), 1))
    vertices = pose_vertices(body, betas, *unpack_theta(motion.theta), offsets)
    np.testing.assert_allclose(made.array("vertices"), vertices, atol=2e-5)


@pytest.mark.usefixtures("blank_strip")
def test_another_network_and_shape_can_be_asked_for(trained_run, motion, tmp_path):
    chosen = predict_motion(
        trained_run, motion, tmp_path / "a", controls=Controls(betas="1" + ",1" * 9)
    )
    assert chosen.manifest["predictor"] == "dsnet_standardised"
    assert chosen.manifest["betas"] == [1.0] * 10
    other = predict_motion(trained_run, motion, tmp_path / "b", predictor="dsnet_faithful")
    assert (other.manifest["predictor"], other.manifest["why"]) == (
        "dsnet_faithful",
        "as requested",
    )
    assert set(other.manifest["arrays"]) == {"latents", "offsets", "vertices"}
    assert np.abs(chosen.array("latents") - other.array("latents")).max() > 0.1
    stages = {stage: trained_run.artifact(stage) for stage in ("train", "train-ae")}
    assert other.manifest["upstream"] == {n: a.content_sha256 for n, a in stages.items()}
    recorded = {key: other.manifest[key] for key in ("source", "source_fps", "fps", "up")}
    assert recorded == {"source": "a_poses.npz", "source_fps": 100.0, "fps": 60.0, "up": "y"}


def test_an_autoencoder_trained_since_is_refused(trained_run, motion, tmp_path):
    write_artifact(trained_run.path / "train-ae", "train-ae", {}, units={}, data="synthetic")
    with pytest.raises(DsnetError, match=r"stage train is older than 'train-ae'.*dsnet train "):
        predict_motion(trained_run, motion, tmp_path / "out")
    assert not list(tmp_path.glob("*out*"))


def test_no_framework_is_loaded(trained_run, motion, tmp_path):
    code = "import sys; from dsnet.cli import main; main(sys.argv[1:])\n"
    code += "sys.exit(bool({'torch', 'tensorflow', 'keras'} & set(sys.modules)))"
    options = ["predict", "--run", "r", "--motion", str(motion), "--out", str(tmp_path / "out")]
    subprocess.run([sys.executable, "-c", code, *options], check=True)
    assert (tmp_path / "out" / "strip.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("changes", "betas"),
    [
        ({"betas": np.full(16, 1e10)}, None),
        ({"betas": np.full(16, 1e308)}, None),
        ({"trans": np.full((51, 3), 1e39)}, None),
        ({"trans": np.full((51, 3), 2e3)}, None),
        ({}, "1e10" + ",0" * 9),
    ],
)
def test_a_body_of_no_persons_size_or_place_is_one_line(
    trained_run, tmp_path, refusal, changes, betas
):
    path = save(tmp_path / "a_poses.npz", smplh(51, 100.0) | {"source": "synthetic"}, **changes)
    options = ["--run", "r", "--motion", str(path), "--out", str(tmp_path / "out")]
    assert "a_poses.npz" in refusal("predict", *options, *(["--betas", betas] if betas else []))
    assert not list(tmp_path.glob("*out*"))


def test_networks_that_give_no_numbers_are_one_line(trained_run, motion, tmp_path, monkeypatch):
    nan = {name: np.full_like(a, np.nan) for name, a in autoencoder_arrays().items()}
    monkeypatch.setattr("bridge.exchange.weights.load_weights", lambda path: nan)
    with pytest.raises(DsnetError, match="not finite from frame 0"):
        predict_motion(trained_run, motion, tmp_path / "out")
    assert not list(tmp_path.glob("*out*"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--motion", "m.npz"], "--motion without --out"),
        (["--out", "o"], "predict without --motion"),
        (["--betas", "1,2,3"], "predict without --motion"),
        ([], "run `dsnet infer` for a run's sequences"),
        (["--motion", "m.npz", "--out", "o", "--betas", "1,2,3"], "10 finite numbers"),
        (["--motion", "m.npz", "--out", "o", "--betas", "nan" + ",0" * 9], "10 finite numbers"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(trained_run, refusal, options, words):
    assert words in refusal("predict", "--run", "r", *options)


def test_latents_of_a_predictor_that_has_none_are_refused(motion, tmp_path, capsys):
    asked = ["predict", "--motion", str(motion), "--out", str(tmp_path / "o"), "--write"]
    with pytest.raises(SystemExit):
        main([*asked, "latents,offsets"])
    assert "--write latents of dsnet_plus, which has none" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


PREDICT = "from dsnet.cli import main; main()"


def files_below(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path): path.read_bytes() for path in files if ".digests" not in path.parts}


@pytest.fixture
def refused(trained_run, motion, tmp_path, refusal):
    """Predict to a folder, and see that one line is all that happens."""

    def run(out: Path) -> str:
        before = files_below(tmp_path)
        printed = refusal("predict", "--run", "r", "--motion", str(motion), "--out", str(out))
        assert files_below(tmp_path) == before
        return printed

    return run


def test_a_stage_of_a_run_and_its_copy_stay(refused, trained_run, tmp_path):
    """What a folder's name says is not asked: its manifest is."""
    assert "train-ae" in refused(trained_run.path / "train-ae")
    assert "run" in refused(trained_run.path / "predict")
    shutil.copytree(trained_run.path / "train", tmp_path / "copy")
    np.save(tmp_path / "copy" / "latents.npy", np.zeros(3))
    assert "kind 'train'" in refused(tmp_path / "copy")


def test_a_folder_of_the_users_own_stays(refused, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    np.save(tmp_path / "mine" / "latents.npy", np.zeros(3))
    assert "holds other files" in refused(tmp_path / "mine")


@pytest.mark.usefixtures("blank_strip")
@pytest.mark.parametrize("name", ["notes.txt", "sub/notes.txt", ".notes"])
def test_a_users_file_beside_an_earlier_prediction_stays(
    trained_run, motion, refused, tmp_path, name
):
    out = tmp_path / "out"
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(out)])
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).write_text("mine")
    assert Path(name).name in refused(out)


@pytest.mark.usefixtures("blank_strip")
def test_an_earlier_prediction_is_replaced(trained_run, motion, tmp_path):
    out = tmp_path / "new" / "out"
    command = ["predict", "--run", "r", "--motion", str(motion), "--out", str(out)]
    main(command)
    first = read_artifact(out, "prediction")
    main([*command, "--betas", ",".join("1" * 10)])
    second = read_artifact(out, "prediction")
    second.verify()
    assert second.manifest["betas"] == [1.0] * 10 != first.manifest["betas"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("place", ["file", "file/x", "file/x/y", "/proc/x"])
def test_a_path_where_nothing_can_be_made_is_one_line(refused, tmp_path, place):
    (tmp_path / "file").write_text("mine")
    assert "--out" in refused(tmp_path / place)


def test_two_predictions_into_one_folder(trained_run, motion, tmp_path):
    """One of them writes it, whole; who comes meanwhile is told so in one line."""
    out = tmp_path / "out"
    command = [sys.executable, "-c", PREDICT, "predict", "--run", "r"]
    options = ["--motion", str(motion), "--out", str(out)]
    started = [
        subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True, env=os.environ)
        for _ in range(3)
    ]
    ended = [(process.communicate()[1], process.returncode) for process in started]
    assert {status for _, status in ended} <= {0, 2}
    assert any(status == 0 for _, status in ended)
    for printed, status in ended:
        assert printed.count("\n") == (2 if status == 0 else 1), printed
        assert status == 0 or "another process" in printed
    read_artifact(out, "prediction").verify()
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == ["out"]


@pytest.mark.usefixtures("blank_strip", "trained_run")
def test_it_ends_with_what_was_made_and_the_command_that_shows_it(motion, tmp_path, capsys):
    out = tmp_path / "o u t"
    options = ["--gain", "2.0", "--part-gain", "belly=0.5", "head=0"]
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(out), *options])
    made = read_artifact(out, KIND)
    last = capsys.readouterr().err.splitlines()[-1]
    largest_mm = 1000 * np.linalg.norm(made.array("offsets"), axis=-1).max()
    frames = len(made.array("offsets"))
    assert largest_mm > 0
    assert f"to {out}: {frames} frames, {frames / 60:.1f} s at 60 fps" in last
    assert f"at most {largest_mm:.1f} mm" in last
    words = shlex.split(last.partition("To look at it: dsnet ")[2])
    page = tmp_path / "o u t.html"
    shown = ["export", "--to", "html", "--motion", str(motion), "--out", str(page)]
    assert words == [*shown, *options, "--run", "r"]
    main(words)
    assert page.stat().st_size > 0
    main(["predict", "--run", "r", "--motion", str(motion), "--out", str(out)])
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"to {out}, in place of an earlier prediction: " in last
