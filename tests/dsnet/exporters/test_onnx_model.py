"""An exported predictor: one file that says what it is, and that ONNX Runtime alone runs."""

from __future__ import annotations

import base64
import errno
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

from bridge.body import load_body_model
from bridge.exchange.dsnet import Scaling, TrainedDsnet
from bridge.runs import Run, write_artifact
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.cli import main
from dsnet.exporters.onnx_model import export_onnx, precision_error_mm
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.prediction.controls import Controls
from dsnet.prediction.models import DsnetModel, Model, PlusModel
from dsnet.verify import draws
from tests.forged.codec import write_codec
from tests.forged.plus import write_plus

BODY = load_body_model("embedded:female")
WIDTHS = (6890, 12, 8, 6, 4)
EXAMPLE = Path(__file__).parents[3] / "examples" / "09_onnx_runtime_only.py"
BETAS = np.zeros((2, 10), np.float32)


@pytest.fixture(scope="module")
def plus() -> TrainedPlus:
    return TrainedPlus.from_arrays(draws.tissue(1, BODY))


def chosen(model: Model, name: str, origin: str = "synthetic") -> Any:
    """What `export_onnx` asks of a `TrainedModel`."""
    return SimpleNamespace(model=model, name=name, origin=origin, body=BODY)


@pytest.fixture(scope="module")
def exported(plus, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "plus.onnx"
    export_onnx(path, chosen(PlusModel(plus, BODY), "dsnet_plus"), run="demo")
    return path


@pytest.fixture(scope="module")
def dsnet(tmp_path_factory) -> DsnetModel:
    decoder = draws.autoencoder_weights(1, WIDTHS)
    decoder["normaliser.mean_m"] = np.zeros((6890, 3), np.float32)
    decoder["normaliser.scale_m"] = np.full((6890, 3), 1e-3, np.float32)
    network = TrainedDsnet("dsnet_faithful", draws.dsnet_weights(2), Scaling.identity())
    folder = tmp_path_factory.mktemp("run") / "train-ae"
    return DsnetModel(network, write_codec(folder, decoder, {"widths": WIDTHS}), BODY)


def metadata(path: Path) -> dict[str, str]:
    return {entry.key: entry.value for entry in onnx.load_model(path).metadata_props}


def test_the_file_says_what_it_is(exported):
    onnx.checker.check_model(onnx.load_model(exported))
    about = metadata(exported)
    wanted = {"run": "demo", "predictor": "dsnet_plus", "data": "synthetic", "gender": "female",
              "fps": "60", "up": "y", "units": "metres, radians", "precision": "float32",
              "latency_frames": "1"}  # fmt: skip
    assert {name: about[name] for name in wanted} == wanted
    assert json.loads(about["joints"])[15] == "head"
    assert len(json.loads(about["joints"])) == 22
    faces = np.frombuffer(base64.b64decode(about["faces"]), "<u4").reshape(-1, 3)
    np.testing.assert_array_equal(faces, BODY.faces)
    assert [path.name for path in exported.parent.iterdir()] == ["plus.onnx"]


def test_the_layout_names_every_column_of_the_state(exported):
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    (theta, betas, state), (vertices, after) = session.get_inputs(), session.get_outputs()
    assert (theta.shape, betas.shape) == (["B", 69], ["B", 10])
    assert (vertices.shape, after.shape) == (["B", 6890, 3], ["B", state.shape[1]])
    layout = json.loads(session.get_modelmeta().custom_metadata_map["state_layout"])
    ends = [start + int(np.prod(shape)) for _, start, shape in layout]
    assert [0, *ends] == [start for _, start, _ in layout] + [state.shape[1]]
    assert [name for name, _, _ in layout[:2]] == ["age", "betas"]


def test_the_papers_network_is_exported_too(dsnet, tmp_path):
    path = tmp_path / "a.onnx"
    export_onnx(path, chosen(dsnet, "dsnet_faithful", "licensed"), precision="float16")
    assert metadata(path)["predictor"] == "dsnet_faithful"
    # Trained on licensed data, but the body is invented.
    assert metadata(path)["data"] == "synthetic"
    state = np.zeros((1, 120), np.float32)
    moved = GraphSession(onnx.load_model(path))(
        theta=np.zeros((1, 69), np.float32), betas=BETAS[:1], state=state
    )
    assert np.isfinite(moved["vertices"]).all()


def test_fewer_bits_are_measured_and_the_file_says_so(dsnet, tmp_path):
    path = tmp_path / "a.onnx"
    export_onnx(path, chosen(dsnet, "dsnet_faithful"), precision="int8")
    about = metadata(path)
    error = json.loads(about["error_mm"])
    assert 0 < error["mean_mm"] < error["percentile_99_mm"] < error["max_mm"] < 1.0
    exact = precision_error_mm(*[onnx.load_model(path)] * 2)
    assert set(exact.values()) == {0.0}


def test_a_run_is_exported_by_its_artifacts(plus, tmp_path, monkeypatch):
    monkeypatch.setenv("DSNET_RUNS", str(tmp_path / "runs"))
    align, body = tmp_path / "runs" / "r" / "align", {"smpl": "embedded:female"}
    write_artifact(align, "align", {}, units={}, data="synthetic", config=body)
    write_plus(Run("r"), plus)
    out = tmp_path / "new" / "a.onnx"
    main(["export", "--to", "onnx", "--run", "r", "--out", str(out)])
    assert [path.name for path in out.parent.iterdir()] == ["a.onnx"]
    assert metadata(out)["run"] == "r"
    theta = np.random.default_rng(1).normal(0, 0.3, (4, 2, 69)).astype(np.float32)
    graphs = onnx.load_model(out), PlusModel(plus, BODY).graph({}, "float32")
    found, expected = (GraphSession(graph).rollout(theta, BETAS) for graph in graphs)
    np.testing.assert_array_equal(found, expected)


def refused(capsys, *options: str) -> str:
    """What `dsnet export --to onnx` says of options, in one line."""
    with pytest.raises(SystemExit) as stopped:
        main(["export", "--to", "onnx", *options])
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    return said.splitlines()[-1]


def test_a_path_that_is_taken_is_refused_before_anything_is_made(exported, capsys, monkeypatch):
    monkeypatch.setattr(Controls, "model", lambda *_: pytest.fail("loaded"))
    before = exported.read_bytes()
    assert "which exists" in refused(capsys, "--out", str(exported))
    assert exported.read_bytes() == before


def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "a.onnx"
    assert "cannot be written" in refused(capsys, "--out", str(path))

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(onnx, "save_model", full)
    assert "No space left" in refused(capsys, "--out", str(tmp_path / "a.onnx"))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_example_runs_with_numpy_and_onnxruntime_alone(exported):
    source = EXAMPLE.read_text()
    assert len(source.splitlines()) <= 40
    assert "bridge" not in source
    done = subprocess.run(
        [sys.executable, "-I", str(EXAMPLE), str(exported)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    first, *frames = done.stdout.splitlines()
    assert first == "dsnet_plus of run 'demo', synthetic data, female"
    assert len(frames) == 6
