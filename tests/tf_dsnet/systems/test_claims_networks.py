"""The studies of claims: what a probe finds, what other betas cost, training by the paper."""

from __future__ import annotations

import numpy as np

from benchmarks.claims.by_the_paper import ByThePaper
from benchmarks.claims.looked_into import probe
from benchmarks.plugin import predictors
from benchmarks.systems.dsnet_variants import DsnetVariant
from bridge.body import BodyModelData
from bridge.exchange.dsnet import UnpaddedClip
from bridge.exchange.train_options import PredictorSettings
from tf_dsnet.predictors import DsnetPredictor, TrainingData

RNG = np.random.default_rng(0)


def motions(count: int, frames: int = 60) -> list[np.ndarray]:
    return [RNG.normal(size=(frames, 69)).cumsum(axis=0) for _ in range(count)]


def test_a_probe_finds_velocities_where_they_are_and_nowhere_else() -> None:
    fitted, judged = motions(6), motions(2)

    def told(theta: np.ndarray) -> np.ndarray:
        return np.concatenate([theta, np.diff(theta, axis=0, prepend=theta[:1])], axis=1)

    def r2(features) -> float:
        return probe([(features(t), t) for t in fitted], [(features(t), t) for t in judged], 1)

    assert r2(told) > 0.95
    assert r2(lambda theta: theta) < 0.1


def clips(count: int, frames: int = 12, size: int = 100) -> list[UnpaddedClip]:
    return [
        UnpaddedClip(*(RNG.normal(size=(frames, n)).astype(np.float32) for n in (79, size)))
        for _ in range(count)
    ]


def data_of(body: BodyModelData) -> TrainingData:
    return TrainingData(clips(3), clips(1), lambda: body)


def test_by_the_paper_dsnet_is_the_runs_own(body, tmp_path) -> None:
    """Bit for bit what `dsnet train` gives as `dsnet_faithful`."""
    data = data_of(body)
    variant = predictors()["dsnet_pca"]
    assert isinstance(variant, DsnetVariant)
    trained = []
    for entry in (ByThePaper(variant), DsnetPredictor("dsnet_pca", "", standardised=False)):
        training = entry.training(PredictorSettings(epochs=2), data, tmp_path / "none")
        for epoch in range(2):
            training.epoch(epoch, validate=True)
        trained.append(training.arrays())
    assert trained[0].keys() == trained[1].keys()
    for name, array in trained[0].items():
        np.testing.assert_array_equal(array, trained[1][name])
