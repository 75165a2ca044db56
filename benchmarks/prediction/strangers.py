"""`python -m benchmarks.prediction.strangers --out FILE`: is the flesh of new people too stiff?

How fast the flesh of people of random shapes swings in its place, after a `dsnet_plus` and after
the law that it learned: the frequency whose spring gives the offset that flesh has, neighbours
included, under a small vertical load. Of every part the softer half of its nodes counts.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from bridge.body import BodyModelData, load_body_model
from bridge.body.parts import PARTS, part_weights
from bridge.paper import N_BETAS
from bridge.runs.files import write_text_atomically
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.onnx_graph import Graph, GraphSession
from dsnet.onnx.tissue_graph import TissueGraph, tissue_constants
from dsnet.prediction.load_model import find_model
from dsnet.synthetic.simulation import TissueSimulator
from dsnet.synthetic.subjects import SUBJECTS

LOOSE = ("chest", "belly", "buttocks", "thighs")
_LOAD_M_S2 = 0.05


@dataclass(frozen=True)
class StrangersConfig:
    """Compare the packaged models of women and men with the own law."""

    out: Path
    """Receives the numbers, JSON."""
    people: int = 200
    """Shapes of each gender."""
    seed: int = 0
    """Of the shapes: normally distributed betas."""


def main(config: StrangersConfig) -> dict[str, Any]:
    """Write the result; also returns it."""
    found = {}
    for gender in ("female", "male"):
        packaged = find_model(None, gender=gender)
        model = TrainedPlus.load(packaged.artifacts["train_plus"])
        body = load_body_model(f"embedded:{gender}")
        rng = np.random.default_rng(config.seed)
        strangers = rng.standard_normal((config.people, N_BETAS))
        known = np.stack([subject.betas for subject in SUBJECTS[gender]])
        found[gender] = {
            name: summary(ratios(model, body, betas))
            for name, betas in (("new people", strangers), ("known people", known))
        }
    command = " ".join(["python", "-m", "benchmarks.prediction.strangers", *sys.argv[1:]])
    results = {"command": command, "found": found}
    write_text_atomically(config.out, json.dumps(results, indent=1) + "\n")
    return results


def ratios(model: TrainedPlus, body: BodyModelData, betas: NDArray) -> dict[str, NDArray]:
    """(P,) by part: model's over law's frequency, median over loose nodes, of betas (P, 10)."""
    nodes = model.nodes.vertices
    after_model = model_hz(model, body, betas)
    parts = part_weights(body)[nodes]
    found: dict[str, list[float]] = {part: [] for part in LOOSE}
    for predicted, shape in zip(after_model, betas, strict=True):
        simulated = law_hz(body, shape)[nodes]
        for part in LOOSE:
            mine = (parts[:, PARTS.index(part)] > 0.5) & np.isfinite(simulated)
            mine &= simulated <= np.median(simulated[mine])
            found[part].append(float(np.median(predicted[mine] / simulated[mine])))
    return {part: np.array(values) for part, values in found.items()}


def model_hz(model: TrainedPlus, body: BodyModelData, betas: NDArray) -> NDArray[np.floating]:
    """(P, K) at the nodes of people of shapes betas (P, 10)."""
    graph = Graph()
    person = tissue_constants(graph, body, model, graph.input("betas", ("B", N_BETAS)))
    sheet = TissueGraph.of(graph, model)
    load = 0.0 * person.normals + graph.array("up", np.array([[0.0], [_LOAD_M_S2], [0.0]]))
    offsets_m = sheet.settled(sheet.springs(person), load)
    run = GraphSession(graph.model("standing", {"offsets": offsets_m}, {}, checked=False), 1)
    raised_m = [run(betas=b[None].astype(np.float32))["offsets"][0, 1] for b in betas]
    return np.sqrt(_LOAD_M_S2 / np.stack(raised_m)) / (2 * np.pi)


def law_hz(body: BodyModelData, betas: NDArray) -> NDArray[np.floating]:
    """(V,) at all vertices of a person (10,); infinite where skin does not move."""
    tissue = TissueSimulator(body, betas).tissue
    raised_m = tissue.settled(np.tile([0.0, _LOAD_M_S2, 0.0], (len(tissue.free), 1))).offsets_m
    found = np.full(body.vertex_count, np.inf)
    found[tissue.free] = np.sqrt(_LOAD_M_S2 / np.maximum(raised_m[:, 1], 1e-12)) / (2 * np.pi)
    return found


def summary(by_part: dict[str, NDArray]) -> dict[str, dict[str, float]]:
    """Median over people, and what is between the tenth and the ninetieth of a hundred; `all` of
    a person is the mean of her parts' logarithms."""
    whole = np.exp(np.mean([np.log(values) for values in by_part.values()], axis=0))
    quantiles = ((0.5, "median"), (0.1, "tenth"), (0.9, "ninetieth"))
    return {
        part: {name: round(float(np.quantile(values, share)), 3) for share, name in quantiles}
        for part, values in {**by_part, "all": whole}.items()
    }


if __name__ == "__main__":
    run_as_process(StrangersConfig, main)
