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
    coupling: Tensor
    """(K, B, 1) dt^2 / 4 times c^2, m^2."""


class Skin(NamedTuple):
    """What is not learned: the nodes of B clips, and who pulls at whom."""

    normals: Tensor
    """(K, B, 3) n."""
    own: Tensor
    """(K, 1, 1) the Laplacian's diagonal, 1/m^2."""
    others: Tensor
    """(K, K) the Laplacian without it."""


class _Step(NamedTuple):
    """What a step from (now, before) computes on its way, (K, B, 3) and (K, B, 1)."""

    twice: Tensor
    pulled: Tensor
    stretched: Tensor
    """P times `now`."""
    stiffer: Tensor
    sheared: Tensor
    """What springs take of `known` before P: spring twice + stiffer before."""
    along: Tensor
    """On the matrix's diagonal along the skin, and what it has more along the normal."""
    beyond: Tensor
    guesses: list[Tensor]
    """Of the next offset, the last of them what it is."""
    pulls: list[Tensor]
    """What the neighbours do at each but the last."""


def roll(skin: Skin, loads: Tensor, now: Tensor, before: Tensor, springs: Springs) -> Tensor:
    """Offsets (T, K, B, 3) of the frames after `now`; see `OscillatorSheet.step`.

    Parameters
    ----------
    loads : (T, K, B, 3) times dt^2, metres.
    now, before : (K, B, 3) offsets to start from, metres; constants.
    """

    @tf.custom_gradient
    def rolled(loads: Tensor, *springs: Tensor):
        given = Springs(*springs)
        found = _forward(skin, loads, now, before, given)

        def backward(slope: Tensor) -> tuple[Tensor, ...]:
            return _backward(skin, loads, tf.concat([[before, now], found], 0), given, slope)

        return found, backward

    return rolled(loads, *springs)


def _forward(skin: Skin, loads: Tensor, now: Tensor, before: Tensor, springs: Springs):
    steps = tf.shape(loads)[0]

    def advance(step: Tensor, now: Tensor, before: Tensor, found: tf.TensorArray) -> tuple:
        after = _step(skin, loads[step], now, before, springs).guesses[-1]
        return step + 1, after, now, found.write(step, after)

    found = tf.TensorArray(tf.float32, steps, element_shape=now.shape)
    state = (tf.constant(0), now, before, found)
    return tf.while_loop(lambda step, *_: step < steps, advance, state)[-1].stack()


def _step(skin: Skin, load: Tensor, now: Tensor, before: Tensor, springs: Springs) -> _Step:
    normal = springs.normal_ratio - 1
    stretched = _stretched(now, normal, skin.normals)
    stiffer = springs.hardening * _dot(now, stretched)
    twice, straight = 2 * now + before, 2 * now - before
    pulled = skin.own * twice + _times(skin.others, twice)
    sheared = springs.spring * twice + stiffer * before
    known = load + straight + springs.drag * before
    known -= _stretched(sheared, normal, skin.normals) + springs.coupling * pulled
    spring = springs.spring + stiffer
    along, beyond = 1 + springs.drag + springs.coupling * skin.own + spring, normal * spring
    guesses, pulls = [straight], []
    for _ in range(SWEEPS):
        pulls.append(_times(skin.others, guesses[-1]))
        left = known - springs.coupling * pulls[-1]
        guesses.append(_divided(left, along, beyond, skin.normals))
    return _Step(twice, pulled, stretched, stiffer, sheared, along, beyond, guesses, pulls)


def _backward(
    skin: Skin, loads: Tensor, offsets: Tensor, springs: Springs, slope: Tensor
) -> tuple[Tensor, ...]:
    """Slopes of `loads` and of each of the springs, from that of the offsets found.

    `offsets` (T + 2, K, B, 3) are those found after the two at the start.
    """
    steps, transposed = tf.shape(loads)[0], tf.transpose(skin.others)

    def retreat(left, of_after, of_now, of_loads, of_springs):
        step = left - 1
        before, now = offsets[step], offsets[step + 1]
        done = _step(skin, loads[step], now, before, springs)
        here = _slopes(skin, transposed, done, now, before, springs, of_after + slope[step])
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
    skin: Skin,
    transposed: Tensor,
    done: _Step,
    now: Tensor,
    before: Tensor,
    springs: Springs,
    of_after: Tensor,
) -> _Slopes:
    """What a step's inputs add to the loss, from what its outcome adds; line by line backwards."""
    of_known = of_along_parts = of_coupling = tf.zeros_like(of_after)
    of_beyond = tf.zeros_like(of_after[..., :1])
    of_guess = of_after
    for guess, pull in zip(done.guesses[:0:-1], done.pulls[::-1], strict=True):
        share = _divided(of_guess, done.along, done.beyond, skin.normals)
        of_known += share
        of_along_parts -= share * guess
        of_beyond -= _dot(share, skin.normals) * _dot(guess, skin.normals)
        of_coupling -= share * pull
        of_guess = -_times(transposed, springs.coupling * share)
    normal = springs.normal_ratio - 1
    of_along = tf.reduce_sum(of_along_parts, -1, keepdims=True)
    of_spring = of_along + normal * of_beyond
    known = _stretched(of_known, normal, skin.normals)
    of_stiffer = of_spring - _dot(known, before)
    of_pulled = springs.coupling * of_known
    of_twice = -(springs.spring * known + (skin.own * of_pulled + _times(transposed, of_pulled)))
    of_straight = of_guess + of_known
    of_stretched = 2 * springs.hardening * of_stiffer * done.stretched
    of_now = 2 * (of_straight + of_twice) + of_stretched
    of_before = of_twice - of_straight + (springs.drag * of_known - done.stiffer * known)
    of_normal = (springs.spring + done.stiffer) * of_beyond
    of_normal -= _dot(of_known, skin.normals) * _dot(done.sheared, skin.normals)
    of_normal += springs.hardening * of_stiffer * tf.square(_dot(now, skin.normals))
    own_pull = skin.own * of_along - _dot(of_known, done.pulled)
    of_springs = Springs(
        drag=of_along + _dot(of_known, before),
        spring=of_spring - _dot(known, done.twice),
        hardening=of_stiffer * _dot(now, done.stretched),
        normal_ratio=of_normal,
        coupling=tf.reduce_sum(of_coupling, -1, keepdims=True) + own_pull,
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


def _times(matrix: Tensor, offsets: Tensor) -> Tensor:
    """(K, K) on the nodes of (K, B, 3)."""
    shape = tf.shape(offsets)
    flat = tf.reshape(offsets, (shape[0], -1))
    return tf.reshape(tf.matmul(matrix, flat), shape)
