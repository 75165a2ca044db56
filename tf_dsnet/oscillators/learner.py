"""One step of training on some windows: the loss, its gradient, and Adam."""

from __future__ import annotations

from collections.abc import Mapping

from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.oscillators.layer import OscillatorLayer

_QUIET_M = 2e-4
"""Root mean square offset below which a clip counts no more for being quiet."""
_QUIET_SHARE = 0.3
Batch = Mapping[str, Tensor]
"""What the layer is called with, `target` (T, K, B, 3), and `counted` (T, 1, B, 1): frames that
are counted as 0 do not matter."""


class OscillatorLearner:
    """A layer and its optimizer."""

    def __init__(self, layer: OscillatorLayer, learning_rate: float) -> None:
        self.layer = layer
        # Keras numbers optimizers that have no name, and a checkpoint knows them by it.
        self.optimizer = keras.optimizers.Adam(learning_rate, beta_2=0.95, name="adam")
        self.optimizer.build(layer.trainable_variables)
        self.step = tf.function(self._step, reduce_retracing=True)
        """The loss before a step that is taken on a batch."""

    def offsets(self, batch: Batch) -> Tensor:
        """(T, K, B, 3)."""
        return self.layer(batch["inertia"], batch["gravity"], batch["now"], batch["before"],
                          batch["normals"], batch["features"], batch["shares"])  # fmt: skip

    def gradients(self, batch: Batch) -> tuple[Tensor, list[Tensor]]:
        """The loss, and the gradient of it and the penalty by the layer's weights."""
        with tf.GradientTape() as tape:
            loss = _loss(self.offsets(batch), batch["target"], batch["counted"])
            total = loss + self.layer.penalty()
        return loss, tape.gradient(total, self.layer.trainable_variables)

    def _step(self, batch: Batch) -> Tensor:
        loss, gradients = self.gradients(batch)
        self.optimizer.apply(gradients, self.layer.trainable_variables)
        return loss


def _loss(found: Tensor, target: Tensor, counted: Tensor) -> Tensor:
    """Share of the energy that is missed; quiet clips count a little more than their share."""
    missed = tf.reduce_mean(counted * tf.square(found - target), (0, 1, 3))
    energy = tf.reduce_mean(counted * tf.square(target), (0, 1, 3))
    quiet = tf.reduce_mean(counted, (0, 1, 3)) * _QUIET_M**2
    overall = tf.reduce_sum(missed) / tf.reduce_sum(energy)
    return overall + _QUIET_SHARE * tf.reduce_mean(missed / (energy + quiet))
