"""A `dsnet_plus` that nobody trained: soft flesh of one frequency and damping everywhere."""

from __future__ import annotations

import numpy as np

from bridge.body import BodyModelData
from bridge.exchange import save_weights
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import NAME, StaticPart, TrainedPlus, Weights


def soft_flesh(
    body: BodyModelData, nodes: int = 60, frequency_hz: float = 5.0, damping_ratio: float = 0.12
) -> TrainedPlus:
    """One known person, of zero betas; no static part."""
    coefficients = {
        "omega": 2 * np.pi * frequency_hz,
        "damping_ratio": damping_ratio,
        "stiffening": 700.0,
        "sag": 0.02,
        "normal_ratio": 1.3,
        "wave_speed": 1.0,
        "bending": 1e-3,
        "inertia_gain": 1.0,
        "gravity_gain": 1.0,
    }
    base = {
        name: np.full((nodes, 1), np.log(value), np.float32) for name, value in coefficients.items()
    }
    weights = Weights(
        base,
        slopes=np.array([[0.0], [0.0], [-0.3]], np.float32),
        stiffening_power=np.array([1.0], np.float32),
        residual=np.zeros((1, nodes, 1), np.float32),
        taps=np.array([0.3, 0.4, 0.3], np.float32),
    )
    vertices = len(body.v_template)
    static = StaticPart(
        np.zeros((1, vertices, 3), np.float32), np.zeros((207, nodes, 3), np.float32)
    )
    people = np.zeros((1, 10), np.float32)
    return TrainedPlus(TissueNodes.of(body, nodes), weights, static, people, look_ahead=1)


def write_plus(run: Run, model: TrainedPlus) -> Artifact:
    """The `train_plus` of a run."""
    writer = ArtifactWriter(run.path / "train_plus", "train_plus", data="synthetic")
    save_weights(writer.file_path(f"{NAME}.safetensors"), model.arrays())
    writer.record(default=NAME, predictors={NAME: {"label": "soft flesh"}})
    return writer.finish()
