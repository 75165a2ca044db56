"""Graphs without control flow: what an engine runs that has no `If`, `Loop` and `Scan`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx.reference import ReferenceEvaluator

import dsnet
from dsnet.cli import main
from dsnet.onnx.onnx_graph import GraphSession
from dsnet.verify import draws
from tests.forged.codec import papers_model

BETAS = np.array([np.zeros(10), np.linspace(-1, 1, 10)], np.float32)


def without_control_flow(graph: onnx.ModelProto) -> ReferenceEvaluator:
    """ONNX's interpreter in NumPy, for a graph none of whose operators holds another."""
    onnx.checker.check_model(graph)
    kinds = {attribute.type for node in graph.graph.node for attribute in node.attribute}
    assert not kinds & {onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS}
    return ReferenceEvaluator(graph)


def run(graph: ReferenceEvaluator, **inputs: NDArray) -> dict[str, NDArray]:
    outputs = graph.run(None, inputs)
    assert isinstance(outputs, list)
    return dict(zip(map(str, graph.output_names), outputs, strict=True))


def test_two_small_graphs_move_a_body(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["export", "--to", "onnx-plain", "--out", str(tmp_path / "plain")])
    assert "wrote" in capsys.readouterr().err
    assert {path.name for path in (tmp_path / "plain").iterdir()} == {"begin.onnx", "step.onnx"}
    files = {
        name: onnx.load_model(tmp_path / "plain" / f"{name}.onnx") for name in ("begin", "step")
    }
    begin, step = (without_control_flow(files[name]) for name in ("begin", "step"))
    about = {entry.key: entry.value for entry in files["step"].metadata_props}
    assert "begin.onnx" in about["state"]
    walk = dsnet.load_motion("sample:walking").theta[:6].astype(np.float32)
    theta = walk[:, None].repeat(2, axis=1)
    state = run(begin, theta=theta[0], betas=BETAS)["state"]
    frames = []
    for poses in theta:
        moved = run(step, theta=poses, betas=BETAS, state=state)
        state = moved["next_state"]
        frames.append(moved)
    trained = dsnet.load_model("female")
    vertices_m = GraphSession(trained.model.graph({}, "float32")).rollout(theta, BETAS)
    found_m = np.stack([moved["vertices"] for moved in frames])
    np.testing.assert_allclose(found_m, vertices_m, atol=1e-6)
    late = int(about["latency_frames"])
    for person, betas in enumerate(BETAS):
        _, offsets_m = dsnet.animate("sample:walking", betas=betas.tolist()).arrays()
        found_m = np.stack([moved["offsets"][person] for moved in frames[late:]])
        np.testing.assert_allclose(found_m, offsets_m[: len(found_m)], atol=1e-6)
        assert np.abs(found_m).max() > 1e-3


def test_the_papers_network_begins_with_zeros(tmp_path: Path) -> None:
    model = papers_model(tmp_path / "train-ae")
    (step,) = model.plain_graphs({}).values()
    given = draws.stream(3, 1, 2)
    inputs = {"theta": given["theta"][0], "betas": given["betas"]}
    inputs["state"] = np.zeros((2, 120), np.float32)
    found = run(without_control_flow(step), **inputs)
    expected = GraphSession(model.graph({}, "float32"))(**inputs)
    for name, array in expected.items():
        np.testing.assert_allclose(found[name], array, atol=1e-5, err_msg=name)
    assert found["offsets"].shape == (2, 6890, 3)
