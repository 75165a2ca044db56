"""Noise on what a network is given of its past, which it will not have so clean by itself."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from tf_dsnet.framework import Tensor, keras, tf

_SEED = 20_18


class HistoryNoise(keras.layers.Layer):
    """Adds Gaussian noise of a given spread for each number (..., D).

    Draws are counted in a weight and follow from their number, so that a training which was
    stopped goes on with those that it would have had.
    """

    def build(self, input_shape: Any) -> None:
        """Spreads are 0 until they are set."""
        self.spread = self.add_weight(name="spread", shape=input_shape[-1:], trainable=False,
                                      initializer="zeros")  # fmt: skip
        self.draws = self.add_weight(name="draws", shape=(1,), trainable=False, dtype="int64",
                                     initializer="zeros")  # fmt: skip
        self.built = True

    def set_spread(self, spread: NDArray) -> None:
        """Set standard deviations (D,)."""
        self.spread.assign(spread)

    def call(self, values: Tensor) -> Tensor:
        """Values (..., D) with noise."""
        seed = tf.concat([tf.constant([_SEED], tf.int64), tf.convert_to_tensor(self.draws)], 0)
        self.draws.assign_add([1])
        return values + self.spread * tf.random.stateless_normal(tf.shape(values), seed)
