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
    held: Tensor
    """(K, B, 1) dt^2 / 4 times w^2 + c^2 L_kk."""
    hardening: Tensor
    """(K, B, 1) dt^2 / 2 times w^2 a, 1/m^2."""
    coupling: Tensor
    """(K, B, 1) dt^2 / 4 times c^2, m^2."""


class _Step(NamedTuple):
    """What a step from (now, before) computes on its way, (K, B, 3) and (K, B, 1)."""

    twice: Tensor
    pulled: Tensor
    stiffer: Tensor
    diagonal: Tensor
    guesses: list[Tensor]
    """Of the next offset, the last of them what it is."""
    pulls: list[Tensor]
    """What the neighbours do at each but the last."""


def roll(others: Tensor, loads: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """Offsets (T, K, B, 3) of the frames after `now`; see `OscillatorSheet.step`.

    Parameters
    ----------
    others : (K, K) Laplacian without its diagonal, 1/m^2; a constant.
    loads : (T, K, B, 3) times dt^2, metres.
    now, before : (K, B, 3) offsets to start from, metres; constants.
    """

    @tf.custom_gradient
    def rolled(loads: Tensor, *springs: Tensor):
        given = Springs(*springs)
        found = _forward(others, loads, now, before, given)

        def backward(slope: Tensor) -> tuple[Tensor, ...]:
            return _backward(others, loads, tf.concat([[before, now], found], 0), given, slope)

        return found, backward

    return rolled(loads, *springs)


def _forward(others: Tensor, loads: Tensor, now: Tensor, before: Tensor, springs: Springs):
    steps = tf.shape(loads)[0]

    def advance(step: Tensor, now: Tensor, before: Tensor, found: tf.TensorArray) -> tuple:
        after = _step(others, loads[step], now, before, springs).guesses[-1]
        return step + 1, after, now, found.write(step, after)

    found = tf.TensorArray(tf.float32, steps, element_shape=now.shape)
    state = (tf.constant(0), now, before, found)
    return tf.while_loop(lambda step, *_: step < steps, advance, state)[-1].stack()


def _step(others: Tensor, load: Tensor, now: Tensor, before: Tensor, springs: Springs) -> _Step:
    stiffer = springs.hardening * tf.reduce_sum(tf.square(now), -1, keepdims=True)
    twice, straight = 2 * now + before, 2 * now - before
    pulled = _times(others, twice)
    known = load + straight + (springs.drag - stiffer) * before
    known -= springs.held * twice + springs.coupling * pulled
    diagonal = 1 + springs.drag + springs.held + stiffer
    guesses, pulls = [straight], []
    for _ in range(SWEEPS):
        pulls.append(_times(others, guesses[-1]))
        guesses.append((known - springs.coupling * pulls[-1]) / diagonal)
    return _Step(twice, pulled, stiffer, diagonal, guesses, pulls)


def _backward(
    others: Tensor, loads: Tensor, offsets: Tensor, springs: Springs, slope: Tensor
) -> tuple[Tensor, ...]:
    """Slopes of `loads` and of each of the springs, from that of the offsets found.

    `offsets` (T + 2, K, B, 3) are those found after the two at the start.
    """
    steps, transposed = tf.shape(loads)[0], tf.transpose(others)

    def retreat(left, of_after, of_now, of_loads, of_springs):
        step = left - 1
        before, now = offsets[step], offsets[step + 1]
        done = _step(others, loads[step], now, before, springs)
        here = _slopes(transposed, done, now, before, springs, of_after + slope[step])
        summed = tuple(a + b for a, b in zip(of_springs, here.springs, strict=True))
        return step, of_now + here.now, here.before, of_loads.write(step, here.load), summed

    nothing = tf.zeros_like(offsets[0])
    of_loads = tf.TensorArray(tf.float32, steps, element_shape=nothing.shape)
    state = (steps, nothing, nothing, of_loads, tuple(tf.zeros_like(s) for s in springs))
    *_, of_loads, of_springs = tf.while_loop(lambda left, *_: left > 0, retreat, state)
    return of_loads.stack(), *of_springs


class _Slopes(NamedTuple):
    load: Tensor
    now: Tensor
    before: Tensor
    springs: Springs


def _slopes(
    transposed: Tensor, done: _Step, now: Tensor, before: Tensor, springs: Springs, of_after: Tensor
) -> _Slopes:
    """What a step's inputs add to the loss, from what its outcome adds; line by line backwards."""
    of_known = of_diagonal = of_coupling = tf.zeros_like(of_after)
    of_guess = of_after
    for guess, pull in zip(done.guesses[:0:-1], done.pulls[::-1], strict=True):
        share = of_guess / done.diagonal
        of_known += share
        of_diagonal -= share * guess
        of_coupling -= share * pull
        of_guess = -_times(transposed, springs.coupling * share)
    of_twice = -springs.held * of_known - _times(transposed, springs.coupling * of_known)
    of_straight = of_guess + of_known
    of_dragged = _dot(of_known, before)
    of_divisor = tf.reduce_sum(of_diagonal, -1, keepdims=True)
    of_stiffer = of_divisor - of_dragged
    of_now = 2 * (of_straight + of_twice) + 2 * springs.hardening * of_stiffer * now
    of_before = of_twice - of_straight + (springs.drag - done.stiffer) * of_known
    of_springs = Springs(
        drag=of_dragged + of_divisor,
        held=of_divisor - _dot(of_known, done.twice),
        hardening=of_stiffer * _dot(now, now),
        coupling=tf.reduce_sum(of_coupling, -1, keepdims=True) - _dot(of_known, done.pulled),
    )
    return _Slopes(of_known, of_now, of_before, of_springs)


def _dot(first: Tensor, second: Tensor) -> Tensor:
    return tf.reduce_sum(first * second, -1, keepdims=True)


def _times(matrix: Tensor, offsets: Tensor) -> Tensor:
    """(K, K) on the nodes of (K, B, 3)."""
    shape = tf.shape(offsets)
    flat = tf.reshape(offsets, (shape[0], -1))
    return tf.reshape(tf.matmul(matrix, flat), shape)
