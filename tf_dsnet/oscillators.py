"""The oscillators as a recurrent Keras layer, its steps through time, and a step of training.

`bridge/tissue/oscillators.py` has the equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.paper import FPS
from bridge.tissue.oscillators import STEPS, SWEEPS
from bridge.tissue.shape import SHAPE_FEATURES
from bridge.tissue.trained_plus import NODE_FIELDS, SAG_POWER, Weights
from tf_dsnet.framework import Tensor, keras, tf

_STEP_S = 1 / (STEPS * FPS)
_QUIET_M = 2e-4
"""Root mean square offset below which a clip counts no more for being quiet."""
_QUIET_SHARE = 0.3
Batch = Mapping[str, Tensor]
"""What the layer is called with, `target` (T, K, B, 3), and `counted` (T, 1, B, 1): frames that
are counted as 0 do not matter."""
START = {
    "omega": 2 * np.pi * 7.0,
    "damping_ratio": 0.15,
    "stiffening": 700.0,
    "sag": 5e-3,
    "normal_ratio": 1.2,
    "wave_speed": 1.0,
    "bending": 1e-3,
    "inertia_gain": 1.0,
    "gravity_gain": 1.0,
}
"""Where training starts: firm flesh; the tissue's own numbers are found from the offsets."""
_SOFT = {
    "omega": 1e-4, "damping_ratio": 1e-2, "stiffening": 3e-3, "sag": 3e-3, "normal_ratio": 3e-3,
    "wave_speed": 1e-2, "bending": 1e-2, "inertia_gain": 3e-2, "gravity_gain": 3e-2,
}  # fmt: skip
"""How strongly nodes are held to be alike."""


class OscillatorLayer(keras.layers.Layer):
    """Offsets of K nodes over time from the loads on them: a recurrent layer of state (u, u-).

    `laplacian` (K, K) is that of `TissueNodes`; there are P known `people`; so many frames of the
    load act on a step as there are `taps`.
    """

    def __init__(self, laplacian: NDArray, people: int, taps: int) -> None:
        super().__init__(name="oscillators")
        count, dtype = len(laplacian), keras.config.floatx()
        laplacian = laplacian.astype(np.float64)
        # Dense: with 500 nodes faster than TensorFlow's sparse product, and as exact.
        self._laplacian = tf.constant(laplacian, dtype)
        self._twice_laplacian = tf.constant(laplacian @ laplacian, dtype)
        logs = {name: float(np.log(START[name])) for name in NODE_FIELDS}
        self._base = {n: self._weight(f"log_{n}", (1,), log) for n, log in logs.items()}
        self._deviation = {n: self._weight(f"by_node_{n}", (count, 1)) for n in NODE_FIELDS}
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
        # What log W of each clip's person has besides the template's, (K, B, 1).
        own = tf.tensordot(features, self._slopes, 1)
        own += tf.einsum("bp,pkx->kbx", shares, self._residuals())
        omega = self._of("omega") * tf.exp(own)
        stiffening = self._of("stiffening") * tf.exp(self._stiffening_power * own)
        sag = self._of("sag") * tf.exp(SAG_POWER * own)
        springs, hung, pull = self._springs(omega, stiffening, sag, normals)
        taps = tf.unstack(self._shares_of_taps())
        whole = self._of("inertia_gain") * _smoothed(inertia, taps)
        whole += self._of("gravity_gain") * _smoothed(gravity, taps)
        loads = _STEP_S**2 * tf.repeat(whole, STEPS, 0) + pull
        # Offsets from the shape without weight, for which flesh hangs under `pull`.

        def step(state: tuple[Tensor, Tensor], load: Tensor) -> tuple[Tensor, Tensor]:
            now, before = state
            return _step(normals, load, now, before, springs), now

        steps, _ = tf.scan(step, loads, (now + hung, before + hung))
        return steps[STEPS - 1 :: STEPS] - hung

    def _springs(
        self, omega: Tensor, stiffening: Tensor, sag: Tensor, normals: Tensor
    ) -> tuple[Springs, Tensor, Tensor]:
        """Of clips' people, (K, B, 1) each; s (K, B, 3), and what holds flesh there, metres."""
        ratio = self._of("normal_ratio") * tf.ones_like(omega)
        hung = sag * tf.constant([0.0, -1.0, 0.0], sag.dtype)
        stretched = _stretched(hung, ratio - 1, normals)
        taut = stiffening * _dot(hung, stretched)
        spring = _STEP_S**2 / 4 * tf.square(omega) / (1 + 3 * taut)
        tension, bending = tf.square(self._of("wave_speed")), self._of("bending")
        coupling = tension[:, 0] * self._laplacian + bending[:, 0] * self._twice_laplacian
        between = _STEP_S**2 / 4 * coupling
        bound = tf.reduce_sum(tf.abs(between), 1)
        springs = Springs(
            drag=self._of("damping_ratio") * omega * _STEP_S,
            spring=spring,
            hardening=2 * spring * stiffening,
            normal_ratio=ratio,
            bound=bound[:, None, None],
            rest=tf.linalg.diag(bound) - between,
        )
        return springs, hung, 4 * (spring * (1 + taut) * stretched + _times(between, hung))

    def _of(self, name: str) -> Tensor:
        """(K, 1, 1)."""
        return tf.exp(self._base[name] + self._deviation[name])[:, None]

    def _residuals(self) -> Tensor:
        """(P, K, 1) without what all people share, which is everybody's: so a stranger has it."""
        residual = tf.convert_to_tensor(self._residual)
        return residual - tf.reduce_mean(residual, 0, keepdims=True)

    def _shares_of_taps(self) -> Tensor:
        taps = tf.convert_to_tensor(self._taps)
        return taps / tf.reduce_sum(taps)

    def penalty(self) -> Tensor:
        """Prior: nodes are alike, people follow their shape, and gains are 1.

        Strengths are per node and in units of the loss, small beside what frames of motion say.
        """
        terms = [w * tf.reduce_mean(tf.square(self._deviation[n])) for n, w in _SOFT.items()]
        gains = [self._base[name] for name in ("inertia_gain", "gravity_gain")]
        terms += [3e-2 * tf.reduce_sum(tf.square(gain)) for gain in gains]
        terms += [3e-3 * tf.reduce_mean(tf.square(tf.convert_to_tensor(self._residual)))]
        return sum(terms)

    def weights_as_arrays(self) -> Weights:
        """What was learned, each node's base and deviation in one."""
        logs = {name: self._base[name] + self._deviation[name] for name in NODE_FIELDS}
        base = {name: log.numpy().astype(np.float32) for name, log in logs.items()}
        rest = (self._slopes, self._stiffening_power, self._residuals(), self._shares_of_taps())
        return Weights(base, *(part.numpy() for part in rest))


def _smoothed(load: Tensor, taps: Sequence[Tensor]) -> Tensor:
    """(T, K, B, 3) of (T + N - 1, K, B, 3): the newest frame of each step by the first tap."""
    newest = len(taps) - 1
    count = tf.shape(load)[0] - newest
    return sum(tap * load[newest - i : newest - i + count] for i, tap in enumerate(taps))


class Springs(NamedTuple):
    """Coefficients of K nodes of B clips, times what dt they need to have no unit of time."""

    drag: Tensor  # (K, B, 1) Z W dt
    spring: Tensor  # (K, B, 1) dt^2 / 4 times w^2
    hardening: Tensor  # (K, B, 1) dt^2 / 2 times w^2 a, 1/m^2
    normal_ratio: Tensor  # (K, B, 1) p
    bound: Tensor  # (K, 1, 1) N: sums over rows of the absolute coupling
    rest: Tensor  # (K, K) N - dt^2 C / 4


def _step(normals: Tensor, load: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """The offset (K, B, 3) that follows `now`; loads are times dt^2. All in metres."""
    normal, rest = springs.normal_ratio - 1, springs.rest
    stiffer = springs.hardening * _dot(now, _stretched(now, normal, normals))
    twice, straight = 2 * now + before, 2 * now - before
    sheared = springs.spring * twice + stiffer * before
    known = load + straight + springs.drag * before - _stretched(sheared, normal, normals)
    known += _times(rest, twice) - springs.bound * twice
    held = springs.spring + stiffer
    along = 1 + springs.drag + springs.bound + held
    after = straight
    for _ in range(SWEEPS):
        after = _divided(known + _times(rest, after), along, normal * held, normals)
    return after


def _stretched(offsets: Tensor, normal: Tensor, normals: Tensor) -> Tensor:
    """P u = u + (p - 1) (n . u) n, with `normal` p - 1."""
    return offsets + normal * _dot(offsets, normals) * normals


def _divided(left: Tensor, along: Tensor, beyond: Tensor, normals: Tensor) -> Tensor:
    """By each node's block along I + beyond n n^T (Sherman and Morrison)."""
    return (left - beyond / (along + beyond) * _dot(left, normals) * normals) / along


def _dot(first: Tensor, second: Tensor) -> Tensor:
    return tf.reduce_sum(first * second, -1, keepdims=True)


def _times(matrix: Tensor, offsets: Tensor) -> Tensor:
    """(K, K) on the nodes of (K, B, 3)."""
    shape = tf.shape(offsets)
    flat = tf.reshape(offsets, (shape[0], -1))
    return tf.reshape(tf.matmul(matrix, flat), shape)


class OscillatorLearner:
    """A layer and its optimizer: a step on some windows, its loss and its gradient."""

    def __init__(self, layer: OscillatorLayer, learning_rate: float) -> None:
        self.layer = layer
        # Keras numbers optimizers that have no name, and a checkpoint knows them by it.
        self.optimizer = keras.optimizers.Adam(learning_rate, beta_2=0.95, name="adam")
        self.optimizer.build(layer.trainable_variables)
        self.gradients = tf.function(self._gradients, reduce_retracing=True)
        """The loss of a batch, and the gradient of it and the penalty by the layer's weights."""
        self.step = tf.function(self._step, reduce_retracing=True)
        """The loss before a step that is taken on a batch."""

    def offsets(self, batch: Batch) -> Tensor:
        """(T, K, B, 3)."""
        return self.layer(batch["inertia"], batch["gravity"], batch["now"], batch["before"],
                          batch["normals"], batch["features"], batch["shares"])  # fmt: skip

    def _gradients(self, batch: Batch) -> tuple[Tensor, list[Tensor]]:
        loss = _loss(self.offsets(batch), batch["target"], batch["counted"])
        weights = [weight.value for weight in self.layer.trainable_variables]
        # Not by the tape, whose sums of many terms come in no order: see `be_reproducible`.
        return loss, tf.gradients(loss + self.layer.penalty(), weights)

    def _step(self, batch: Batch) -> Tensor:
        loss, gradients = self._gradients(batch)
        self.optimizer.apply(gradients, self.layer.trainable_variables)
        return loss


def _loss(found: Tensor, target: Tensor, counted: Tensor) -> Tensor:
    """Share of the energy that is missed; quiet clips count a little more than their share."""
    missed = tf.reduce_mean(counted * tf.square(found - target), (0, 1, 3))
    energy = tf.reduce_mean(counted * tf.square(target), (0, 1, 3))
    quiet = tf.reduce_mean(counted, (0, 1, 3)) * _QUIET_M**2
    overall = tf.reduce_sum(missed) / tf.reduce_sum(energy)
    return overall + _QUIET_SHARE * tf.reduce_mean(missed / (energy + quiet))
