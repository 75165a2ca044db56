"""Gaussians about known bodies: how near a shape is to each of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from bridge.paper import N_BETAS
from tf_dsnet.framework import Tensor, keras, tf


class RadialBasis(keras.layers.Layer):
    """exp(-|b - c|^2 / 2 w^2) of betas (B, 10) for each of C centres c: (B, C).

    Centres and width are set, not learned; w is the median distance between centres.
    """

    def __init__(self, centres: int, **options) -> None:
        super().__init__(**options)
        shape = (centres, N_BETAS)
        self.centres = self.add_weight(name="centres", shape=shape, trainable=False)
        self.width = self.add_weight(name="width", shape=(1,), initializer="ones", trainable=False)

    def call(self, betas: Tensor) -> Tensor:
        """(B, C)."""
        apart = tf.reduce_sum(tf.square(betas[:, None] - self.centres[None]), -1)
        return tf.exp(-apart / (2 * tf.square(self.width)))

    def centre_on(self, people: NDArray) -> None:
        """Put the centres on the shapes (C, 10)."""
        self.centres.assign(people)
        self.width.assign([np.median(pdist(people)) if len(people) > 1 else 1.0])
