"""Steps of the oscillators through time in TensorFlow, with the gradient written out.

The tape's own gradient of such a loop adds up three and more terms with AddN, which adds them in
the order in which threads leave it a buffer, so that no two trainings gave the same bits. Here
every sum has two terms. The gradient goes back through the frames that were found, and keeps
nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

from bridge.tissue.oscillators import SWEEPS
from tf_dsnet.framework import Tensor, tf


class Springs(NamedTuple):
    """Coefficients of K nodes of B clips, times what dt they need to have no unit of time."""

    drag: Tensor
    """(K, B, 1) z w dt."""
    spring: Tensor
    """(K, B, 1) dt^2 / 4 times w^2."""
    hardening: Tensor
    """(K, B, 1) dt^2 / 2 times w^2 a, 1/m^2."""
    normal_ratio: Tensor
    """(K, B, 1) p."""
    bound: Tensor
    """(K, 1, 1) N: sums over rows of the absolute coupling."""
    rest: Tensor
    """(K, K) N - dt^2 C / 4."""


class _Step(NamedTuple):
    """What a step from (now, before) computes on its way, (K, B, 3) and (K, B, 1)."""

    twice: Tensor
    stretched: Tensor
    """P times `now`."""
    stiffer: Tensor
    sheared: Tensor
    """What springs take of `known` before P: spring twice + stiffer before."""
    along: Tensor
    """On the diagonal of B + N along the skin, and what it has more along the normal."""
    beyond: Tensor
    guesses: list[Tensor]
    """Of the next offset, before the first sweep and after each; the last is what it is."""


def roll(normals: Tensor, loads: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """Offsets (T, K, B, 3) of the steps after `now`; see `bridge.tissue.oscillators`.

    Parameters
    ----------
    normals : (K, B, 3) n; a constant.
    loads : (T, K, B, 3) times dt^2, metres.
    now, before : (K, B, 3) offsets to start from, metres; constants.
    """

    @tf.custom_gradient
    def rolled(loads: Tensor, *springs: Tensor):
        given = Springs(*springs)
        found = _forward(normals, loads, now, before, given)

        def backward(slope: Tensor) -> tuple[Tensor, ...]:
            return _backward(normals, loads, tf.concat([[before, now], found], 0), given, slope)

        return found, backward

    return rolled(loads, *springs)


def _forward(normals: Tensor, loads: Tensor, now: Tensor, before: Tensor, springs: Springs):
    steps = tf.shape(loads)[0]

    def advance(step: Tensor, now: Tensor, before: Tensor, found: tf.TensorArray) -> tuple:
        after = _step(normals, loads[step], now, before, springs).guesses[-1]
        return step + 1, after, now, found.write(step, after)

    found = tf.TensorArray(now.dtype, steps, element_shape=now.shape)
    state = (tf.constant(0), now, before, found)
    return tf.while_loop(lambda step, *_: step < steps, advance, state)[-1].stack()


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
    """Slopes of `loads` and of each of the springs, from that of the offsets found.

    `offsets` (T + 2, K, B, 3) are those found after the two at the start.
    """
    steps = tf.shape(loads)[0]

    def retreat(left, of_after, of_now, of_loads, of_springs):
        step = left - 1
        before, now = offsets[step], offsets[step + 1]
        done = _step(normals, loads[step], now, before, springs)
        here = _slopes(normals, done, now, before, springs, of_after + slope[step])
        summed = tuple(a + b for a, b in zip(of_springs, here.springs, strict=True))
        return step, of_now + here.now, here.before, of_loads.write(step, here.load), summed

    nothing = tf.zeros_like(offsets[0])
    of_loads = tf.TensorArray(nothing.dtype, steps, element_shape=nothing.shape)
    state = (steps, nothing, nothing, of_loads, tuple(tf.zeros_like(s) for s in springs))
    *_, of_loads, of_springs = tf.while_loop(lambda left, *_: left > 0, retreat, state)
    return of_loads.stack(), *of_springs


class _Slopes(NamedTuple):
    load: Tensor
    now: Tensor
    before: Tensor
    springs: Springs


def _slopes(
    normals: Tensor, done: _Step, now: Tensor, before: Tensor, springs: Springs, of_after: Tensor
) -> _Slopes:
    """What a step's inputs add to the loss, from what its outcome adds; line by line backwards."""
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
    return _Slopes(of_known, of_now, of_before, of_springs)


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
