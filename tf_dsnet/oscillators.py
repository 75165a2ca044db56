"""The oscillators as a recurrent Keras layer, its steps through time, and a step of training.

`bridge/tissue/oscillators.py` has the equations. The gradient of the steps is written out: the
tape's own gradient of such a loop adds up three and more terms with AddN, which adds them in the
order in which threads leave it a buffer, so that no two trainings gave the same bits. Here every
sum has two terms. The gradient goes back through the frames that were found, and keeps nothing
else.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.tissue.oscillators import FPS, STEPS, SWEEPS
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
        of_omega, of_stiffening, of_sag = _several(own, 3)
        omega = self._of("omega") * tf.exp(of_omega)
        stiffening = self._of("stiffening") * tf.exp(self._stiffening_power * of_stiffening)
        sag = self._of("sag") * tf.exp(SAG_POWER * of_sag)
        springs, hung, pull = self._springs(omega, stiffening, sag, normals)
        taps = tf.unstack(self._shares_of_taps())
        felt = self._of("inertia_gain") * _smoothed(inertia, taps)
        felt += self._of("gravity_gain") * _smoothed(gravity, taps)
        loads = _STEP_S**2 * tf.repeat(felt, STEPS, 0) + pull
        # Offsets from the shape without weight, for which flesh hangs under `pull`.
        hung, hung_start = _several(hung, 2)
        now, before = tf.unstack(tf.stack([now, before]) + hung_start)
        steps = roll(normals, loads, now, before, springs)
        return steps[STEPS - 1 :: STEPS] - hung

    def _springs(
        self, omega: Tensor, stiffening: Tensor, sag: Tensor, normals: Tensor
    ) -> tuple[Springs, Tensor, Tensor]:
        """Of clips' people, (K, B, 1) each; s (K, B, 3), and what holds flesh there, metres."""
        ratios = _several(self._of("normal_ratio") * tf.ones_like(omega), 2)
        hung, *others = _several(sag * tf.constant([0.0, -1.0, 0.0], sag.dtype), 4)
        stretched, pulled = _several(_stretched(others[0], ratios[1] - 1, normals), 2)
        taut = stiffening * _dot(others[1], stretched)
        spring, *more = _several(_STEP_S**2 / 4 * tf.square(omega) / (1 + 3 * taut), 3)
        tension, bending = tf.square(self._of("wave_speed")), self._of("bending")
        coupling = tension[:, 0] * self._laplacian + bending[:, 0] * self._twice_laplacian
        between, *same = _several(_STEP_S**2 / 4 * coupling, 3)
        bound = tf.reduce_sum(tf.abs(between), 1)
        springs = Springs(
            drag=self._of("damping_ratio") * omega * _STEP_S,
            spring=spring,
            hardening=2 * more[0] * stiffening,
            normal_ratio=ratios[0],
            bound=bound[:, None, None],
            rest=tf.linalg.diag(bound) - same[0],
        )
        return springs, hung, 4 * (more[1] * (1 + taut) * pulled + _times(same[1], others[2]))

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
        return reduce(operator.add, terms)

    def weights_as_arrays(self) -> Weights:
        """What was learned, each node's base and deviation in one."""
        logs = {name: self._base[name] + self._deviation[name] for name in NODE_FIELDS}
        base = {name: log.numpy().astype(np.float32) for name, log in logs.items()}
        rest = (self._slopes, self._stiffening_power, self._residuals(), self._shares_of_taps())
        return Weights(base, *(part.numpy() for part in rest))


def _several(tensor: Tensor, uses: int) -> list[Tensor]:
    """The same for some uses, whose slopes are added two by two."""
    apart = []
    for _ in range(uses - 1):
        apart.append(tf.identity(tensor))
        tensor = tf.identity(tensor)
    return [tensor, *apart]


def _smoothed(load: Tensor, taps: Sequence[Tensor]) -> Tensor:
    """(T, K, B, 3) of (T + N - 1, K, B, 3): the newest frame of each step by the first tap."""
    newest = len(taps) - 1
    count = tf.shape(load)[0] - newest
    parts = [tap * load[newest - i : newest - i + count] for i, tap in enumerate(taps)]
    return reduce(operator.add, parts)


class Springs(NamedTuple):
    """Coefficients of K nodes of B clips, times what dt they need to have no unit of time."""

    drag: Tensor  # (K, B, 1) Z W dt
    spring: Tensor  # (K, B, 1) dt^2 / 4 times w^2
    hardening: Tensor  # (K, B, 1) dt^2 / 2 times w^2 a, 1/m^2
    normal_ratio: Tensor  # (K, B, 1) p
    bound: Tensor  # (K, 1, 1) N: sums over rows of the absolute coupling
    rest: Tensor  # (K, K) N - dt^2 C / 4


class _Step(NamedTuple):
    """What a step from (now, before) computes on its way, (K, B, 3) and (K, B, 1)."""

    twice: Tensor
    stretched: Tensor  # P times `now`
    stiffer: Tensor
    sheared: Tensor  # what springs take of `known` before P: spring twice + stiffer before
    along: Tensor  # on the diagonal of B + N along the skin
    beyond: Tensor  # what it has more along the normal
    guesses: list[Tensor]
    """Of the next offset, before the first sweep and after each; the last is what it is."""


def roll(normals: Tensor, loads: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """Offsets v (T, K, B, 3) of the steps after `now`; see `bridge.tissue.oscillators`.

    Parameters
    ----------
    normals : (K, B, 3) n; a constant.
    loads : (T, K, B, 3) times dt^2, metres.
    now, before : (K, B, 3) offsets to start from, metres.
    """

    @tf.custom_gradient
    def rolled(loads: Tensor, now: Tensor, before: Tensor, *springs: Tensor):
        steps, given = tf.shape(loads)[0], Springs(*springs)

        def advance(step: Tensor, now: Tensor, before: Tensor, found: tf.TensorArray) -> tuple:
            after = _step(normals, loads[step], now, before, given).guesses[-1]
            return step + 1, after, now, found.write(step, after)

        empty = tf.TensorArray(now.dtype, steps, element_shape=now.shape)
        state = (tf.constant(0), now, before, empty)
        found = tf.while_loop(lambda step, *_: step < steps, advance, state)[-1].stack()

        def backward(slope: Tensor) -> tuple[Tensor, ...]:
            return _backward(normals, loads, tf.concat([[before, now], found], 0), given, slope)

        return found, backward

    return rolled(loads, now, before, *springs)


def _step(normals: Tensor, load: Tensor, now: Tensor, before: Tensor, springs: Springs) -> _Step:
    normal = springs.normal_ratio - 1
    stretched = _stretched(now, normal, normals)
    stiffer = springs.hardening * _dot(now, stretched)
    twice, straight = 2 * now + before, 2 * now - before
    sheared = springs.spring * twice + stiffer * before
    known = load + straight + springs.drag * before
    known -= _stretched(sheared, normal, normals)
    known += _times(springs.rest, twice) - springs.bound * twice
    spring = springs.spring + stiffer
    along, beyond = 1 + springs.drag + springs.bound + spring, normal * spring
    guesses = [straight]
    for _ in range(SWEEPS):
        left = known + _times(springs.rest, guesses[-1])
        guesses.append(_divided(left, along, beyond, normals))
    return _Step(twice, stretched, stiffer, sheared, along, beyond, guesses)


def _backward(
    normals: Tensor, loads: Tensor, offsets: Tensor, springs: Springs, slope: Tensor
) -> tuple[Tensor, ...]:
    """Slopes of `loads`, of the offsets at the start, the later first, and of each of the springs,
    from that of the offsets found.

    `offsets` (T + 2, K, B, 3) are those found after the two at the start.
    """
    steps = tf.shape(loads)[0]

    def retreat(left, of_after, of_now, of_loads, of_springs):
        step = left - 1
        before, now = offsets[step], offsets[step + 1]
        done = _step(normals, loads[step], now, before, springs)
        load, in_now, in_before, in_springs = _slopes(
            normals, done, now, before, springs, of_after + slope[step]
        )
        summed = tuple(a + b for a, b in zip(of_springs, in_springs, strict=True))
        return step, of_now + in_now, in_before, of_loads.write(step, load), summed

    nothing = tf.zeros_like(offsets[0])
    of_loads = tf.TensorArray(nothing.dtype, steps, element_shape=nothing.shape)
    state = (steps, nothing, nothing, of_loads, tuple(tf.zeros_like(s) for s in springs))
    _, of_now, of_before, of_loads, of_springs = tf.while_loop(
        lambda left, *_: left > 0, retreat, state
    )
    return of_loads.stack(), of_now, of_before, *of_springs


def _slopes(
    normals: Tensor, done: _Step, now: Tensor, before: Tensor, springs: Springs, of_after: Tensor
) -> tuple[Tensor, Tensor, Tensor, Springs]:
    """What a step's load, `now`, `before` and springs add to the loss, from what its outcome adds;
    line by line backwards."""
    transposed, normal = tf.transpose(springs.rest), springs.normal_ratio - 1
    of_known = of_inverse = tf.zeros_like(of_after)
    of_beyond = tf.zeros_like(of_after[..., :1])
    of_guess, shares = of_after, []
    for swept in reversed(done.guesses[1:]):
        share = _divided(of_guess, done.along, done.beyond, normals)
        shares.append(share)
        of_known += share
        of_inverse -= share * swept
        of_beyond -= _dot(share, normals) * _dot(swept, normals)
        of_guess = _times(transposed, share)
    of_along = tf.reduce_sum(of_inverse, -1, keepdims=True)
    of_spring = of_along + normal * of_beyond
    known = _stretched(of_known, normal, normals)
    of_stiffer = of_spring - _dot(known, before)
    of_pulled = _times(transposed, of_known) - springs.bound * of_known
    of_twice = of_pulled - springs.spring * known
    of_straight = of_guess + of_known
    of_stretched = 2 * springs.hardening * of_stiffer * done.stretched
    of_now = 2 * (of_straight + of_twice) + of_stretched
    of_before = of_twice - of_straight + (springs.drag * of_known - done.stiffer * known)
    of_normal = (springs.spring + done.stiffer) * of_beyond
    of_normal -= _dot(of_known, normals) * _dot(done.sheared, normals)
    of_normal += springs.hardening * of_stiffer * tf.square(_dot(now, normals))
    of_bound = of_along - _dot(of_known, done.twice)
    of_springs = Springs(
        drag=of_along + _dot(of_known, before),
        spring=of_spring - _dot(known, done.twice),
        hardening=of_stiffer * _dot(now, done.stretched),
        normal_ratio=of_normal,
        bound=tf.reduce_sum(of_bound, 1, keepdims=True),
        rest=_outer([of_known, *shares[::-1]], [done.twice, *done.guesses[:-1]]),
    )
    return of_known, of_now, of_before, of_springs


def _stretched(offsets: Tensor, normal: Tensor, normals: Tensor) -> Tensor:
    """P u = u + (p - 1) (n . u) n, with `normal` p - 1."""
    return offsets + normal * _dot(offsets, normals) * normals


def _divided(left: Tensor, along: Tensor, beyond: Tensor, normals: Tensor) -> Tensor:
    """By each node's block along I + beyond n n^T (Sherman and Morrison)."""
    return (left - beyond / (along + beyond) * _dot(left, normals) * normals) / along


def _dot(first: Tensor, second: Tensor) -> Tensor:
    return tf.reduce_sum(first * second, -1, keepdims=True)


def _outer(first: list[Tensor], second: list[Tensor]) -> Tensor:
    """(K, K) sum over all pairs, clips and axes of first times second."""
    left, right = (tf.reshape(tf.stack(x, 1), (tf.shape(x[0])[0], -1)) for x in (first, second))
    return tf.matmul(left, right, transpose_b=True)


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
