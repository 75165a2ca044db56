"""What a shape says of tissue is the same in a graph; so are rest and who is known."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.tissue.oscillators import coupling
from bridge.tissue.trained_plus import TrainedPlus, known_person
from dsnet.onnx.onnx_graph import Graph, GraphSession
from dsnet.onnx.tissue_graph import TissueConstants, TissueGraph, tissue_constants, training_people
from dsnet.verify import draws
from dsnet.verify.reference.oscillators import Oscillators, coefficients

BODY = load_body_model("embedded:female")
MODEL = TrainedPlus.from_arrays(draws.tissue(3, BODY))
BETAS = np.stack([np.zeros(10), MODEL.people_betas[1], np.linspace(-2, 2, 10)]).astype(np.float32)


@pytest.fixture(scope="module")
def found() -> dict[str, np.ndarray]:
    graph = Graph()
    betas = graph.input("betas", ("B", 10))
    person = tissue_constants(graph, BODY, MODEL, betas)
    outputs = {**vars(person), "known": training_people(graph, MODEL, betas)}
    return GraphSession(graph.model("person", outputs, {}))(betas=BETAS)


def test_coefficients_are_the_models(found):
    for row, betas in enumerate(BETAS):
        mechanics = coefficients(MODEL, BODY, betas)
        for name in ("omega", "stiffening", "sag"):
            wanted = getattr(mechanics, name)[:, 0]
            np.testing.assert_allclose(found[name][row, 0], wanted, rtol=1e-5, err_msg=name)
        np.testing.assert_allclose(found["normals"][row].T, mechanics.normals, atol=1e-5)
    assert np.ptp(found["omega"], axis=0).min() > 0


def test_the_known_are_known(found):
    wanted = [known_person(betas, MODEL.people_betas) for betas in BETAS]
    np.testing.assert_array_equal(found["known"], wanted)
    assert found["known"].sum() == 1


def test_rest_is_the_sheets():
    mechanics = coefficients(MODEL, BODY, BETAS[2])
    sheet = Oscillators(mechanics, MODEL.nodes.laplacian.toarray())
    load = np.random.default_rng(5).normal(0, 8, (3, len(MODEL.nodes), 3)).astype(np.float32)
    graph = Graph()
    shapes = {"omega": 1, "stiffening": 1, "sag": 1, "normals": 3}
    own = {name: graph.input(name, ("B", rows, "K")) for name, rows in shapes.items()}
    even = {name: np.exp(log) for name, log in MODEL.weights.base.items()}
    made = TissueGraph(graph, even, coupling(even, MODEL.nodes.laplacian), [1.0])
    settled = made.settled(made.springs(TissueConstants(**own)), graph.input("load", ("B", 3, "K")))
    shape = {"settled": ("B", 3, "K")}
    run = GraphSession(graph.model("settled", {"settled": settled}, shape))
    batch = {
        name: np.repeat(getattr(mechanics, name).T[None], 3, axis=0).astype(np.float32)
        for name in shapes
    }
    result = run(**batch, load=np.ascontiguousarray(load.swapaxes(1, 2)))["settled"]
    for row in range(3):
        wanted = sheet.settled(load[row])
        np.testing.assert_allclose(result[row].T, wanted, atol=1e-7)
        assert np.abs(wanted).max() > 1e-3
