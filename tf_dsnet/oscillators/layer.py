"""The oscillators as a recurrent Keras layer; `bridge/tissue/oscillators.py` has the equations."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import FPS, STEPS
from bridge.tissue.shape import SHAPE_FEATURES
from bridge.tissue.trained_plus import NODE_FIELDS, Weights
from tf_dsnet.framework import Tensor, keras, tf
from tf_dsnet.oscillators.stepping import Springs, roll

START = {
    "omega": 2 * np.pi * 7.0,
    "damping_ratio": 0.15,
    "stiffening": 700.0,
    "normal_ratio": 1.2,
    "wave_speed": 1.0,
    "bending": 1e-3,
    "inertia_gain": 1.0,
    "gravity_gain": 1.0,
}
"""Where training starts: firm flesh; the tissue's own numbers are found from the offsets."""


class OscillatorLayer(keras.layers.Layer):
    """Offsets of K nodes over time from the loads on them: a recurrent layer of state (u, u-).

    Parameters
    ----------
    laplacian : (K, K) of `TissueNodes`.
    people : P known people.
    taps : how many frames of the load act on a step.
    """

    def __init__(self, laplacian: NDArray, people: int, taps: int) -> None:
        super().__init__(name="oscillators")
        count, dtype = len(laplacian), keras.config.floatx()
        laplacian = laplacian.astype(np.float64)
        # Dense: with 500 nodes faster than TensorFlow's sparse product, and as exact.
        self._laplacian = tf.constant(laplacian, dtype)
        self._twice_laplacian = tf.constant(laplacian @ laplacian, dtype)
        self._base = {
            name: self._weight(f"log_{name}", (1,), float(np.log(START[name])))
            for name in NODE_FIELDS
        }
        self._deviation = {
            name: self._weight(f"by_node_{name}", (count, 1)) for name in NODE_FIELDS
        }
        self._slopes = self._weight("slopes", (len(SHAPE_FEATURES), 1))
        self._stiffening_power = self._weight("stiffening_power", (1,))
        self._residual = self._weight("residual", (people, count, 1))
        self._taps = self._weight("taps", (taps,), 1.0 / taps)

    def _weight(self, name: str, shape: tuple[int, ...], value: float = 0.0) -> keras.Variable:
        start = keras.initializers.Constant(value)
        return self.add_weight(name=name, shape=shape, initializer=start)

    def call(self, inertia: Tensor, gravity: Tensor, now: Tensor, before: Tensor,
             normals: Tensor, features: Tensor, shares: Tensor) -> Tensor:  # fmt: skip
        """Offsets (T, K, B, 3) of the frames that follow `now`.

        Parameters
        ----------
        inertia, gravity : (T + N - 1, K, B, 3) loads, m/s^2, from `N - 1` frames before the step's
            oldest tap to the newest of the last step.
        now, before : (K, B, 3) offsets to start from, a step and not a frame apart, metres.
        normals : (K, B, 3) of each clip's person, in the rest pose.
        features : (K, B, 3) of `shape_features`, of each clip's person.
        shares : (B, P) of `shares_of_people`.
        """
        own = self._own(features, shares)
        omega = self._of("omega") * tf.exp(own)
        stiffening = self._of("stiffening") * tf.exp(self._stiffening_power * own)
        step_s = 1 / (STEPS * FPS)
        square = step_s**2
        spring = square / 4 * tf.square(omega)
        coupling = square / 4 * self._coupling()
        bound = tf.reduce_sum(tf.abs(coupling), 1)
        springs = Springs(
            drag=self._of("damping_ratio") * omega * step_s,
            spring=spring,
            hardening=2 * spring * stiffening,
            normal_ratio=self._of("normal_ratio") * tf.ones_like(omega),
            bound=bound[:, None, None],
            rest=tf.linalg.diag(bound) - coupling,
        )
        taps = tf.unstack(self._shares_of_taps())
        felt = self._of("inertia_gain") * _smoothed(inertia, taps)
        felt += self._of("gravity_gain") * _smoothed(gravity, taps)
        steps = roll(normals, tf.repeat(square * felt, STEPS, 0), now, before, springs)
        return steps[STEPS - 1 :: STEPS]

    def _own(self, features: Tensor, shares: Tensor) -> Tensor:
        """(K, B, 1) what log w of each clip's person has besides the template's."""
        by_shape = tf.tensordot(features, self._slopes, 1)
        return by_shape + tf.einsum("bp,pkx->kbx", shares, tf.convert_to_tensor(self._residual))

    def _coupling(self) -> Tensor:
        """(K, K) C."""
        tension, bending = tf.square(self._of("wave_speed")), self._of("bending")
        return tension[:, 0] * self._laplacian + bending[:, 0] * self._twice_laplacian

    def _of(self, name: str) -> Tensor:
        """(K, 1, 1)."""
        return tf.exp(self._base[name] + self._deviation[name])[:, None]

    def _shares_of_taps(self) -> Tensor:
        taps = tf.convert_to_tensor(self._taps)
        return taps / tf.reduce_sum(taps)

    def penalty(self) -> Tensor:
        """Prior: nodes are alike, people follow their shape, and gains are 1.

        Strengths are per node and in units of the loss, small beside what frames of motion say.
        """
        soft = {"omega": 1e-4, "damping_ratio": 1e-2, "stiffening": 3e-3, "normal_ratio": 3e-3,
                "wave_speed": 1e-2, "bending": 1e-2, "inertia_gain": 3e-2,
                "gravity_gain": 3e-2}  # fmt: skip
        terms = [w * tf.reduce_mean(tf.square(self._deviation[n])) for n, w in soft.items()]
        terms += [
            3e-2 * tf.reduce_sum(tf.square(self._base[name]))
            for name in ("inertia_gain", "gravity_gain")
        ]
        terms += [3e-3 * tf.reduce_mean(tf.square(tf.convert_to_tensor(self._residual)))]
        return reduce(operator.add, terms)

    def weights_as_arrays(self) -> Weights:
        """What was learned, each node's base and deviation in one."""
        base = {
            name: (self._base[name] + self._deviation[name]).numpy().astype(np.float32)
            for name in NODE_FIELDS
        }
        taps = self._shares_of_taps().numpy()
        return Weights(base, self._slopes.numpy(), self._stiffening_power.numpy(),
                       self._residual.numpy(), taps)  # fmt: skip


def _smoothed(load: Tensor, taps: Sequence[Tensor]) -> Tensor:
    """(T, K, B, 3) of (T + N - 1, K, B, 3): the newest frame of each step by the first tap."""
    newest = len(taps) - 1
    count = tf.shape(load)[0] - newest
    parts = [tap * load[newest - i : newest - i + count] for i, tap in enumerate(taps)]
    return reduce(operator.add, parts)
