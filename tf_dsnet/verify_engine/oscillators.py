"""The oscillators in Keras: offsets of some windows, and the product's learner looked into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.verify.answers import learn, prefixed
from bridge.verify.protocol import Case, Tensors
from tf_dsnet.framework import tf
from tf_dsnet.oscillators import OscillatorLayer, OscillatorLearner
from tf_dsnet.verify_engine.precision import compute_in, exact


def train(case: Case) -> Tensors:
    """Offsets, loss and gradients of the first pass, and the steps after it."""
    learner = _Learner(case)
    return prefixed("layer", {"offsets": learner.offsets()}) | learn(case, learner)


class _Learner:
    def __init__(self, case: Case) -> None:
        compute_in(case.dtype)
        weights, given = case.weights(), case.inputs()
        layer = OscillatorLayer(
            given.pop("laplacian"), len(weights["residual"]), len(weights["taps"])
        )
        for variable in layer.weights:
            variable.assign(weights[variable.name])
        # Stored in float32, unit vectors are so to eight digits.
        given["normals"] /= np.linalg.norm(given["normals"], axis=-1, keepdims=True)
        self._batch = {name: tf.constant(array) for name, array in given.items()}
        self._learner = OscillatorLearner(layer, case.options["adam"]["learning_rate"])
        exact(self._learner.optimizer)

    def offsets(self) -> NDArray:
        return self._learner.offsets(self._batch).numpy()

    def first_pass(self) -> tuple[float, Tensors]:
        loss, slopes = self._learner.gradients(self._batch)
        return float(loss), self._named([slope.numpy() for slope in slopes])

    def step(self) -> float:
        return float(self._learner.step(self._batch))

    def state(self) -> dict[str, Tensors]:
        variables, moments = (
            self._learner.layer.trainable_variables,
            self._learner.optimizer.variables,
        )
        kept = {"weight": self._named([v.numpy() for v in variables])}
        for kind, end in (("adam_m", "_momentum"), ("adam_v", "_velocity")):
            kept[kind] = self._named([v.numpy() for v in moments if v.path.endswith(end)])
        return kept

    def _named(self, arrays: list[NDArray]) -> Tensors:
        names = [variable.name for variable in self._learner.layer.trainable_variables]
        return dict(zip(names, arrays, strict=True))
