"""The oscillators of `dsnet_plus` as parts of an ONNX graph: loads, a frame, and rest.

`bridge.tissue.oscillators` has the equations. Nodes are the last axis, (B, 3, K): then a coupling
of nodes is one matrix product for all B characters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.runtime.graphs.onnx_values import Value, ValueGraph
from bridge.tissue.load import GRAVITY_M_S2
from bridge.tissue.oscillators import FPS, STEPS, SWEEPS

_SETTLING = 400
"""Sweeps at most; sixty do for flesh that was trained."""
_SETTLED_M = 1e-9
"""Largest change in a sweep at which tissue is at rest."""


@dataclass(frozen=True, eq=False)
class Person:
    """What a shape says of B characters' tissue."""

    omega: Value
    """(B, 1, K) 1/s."""
    stiffening: Value
    """(B, 1, K) 1/m^2."""
    normals: Value
    """(B, 3, K)."""


@dataclass(frozen=True, eq=False)
class StepSprings:
    """A person's coefficients of one step, (B, 1, K)."""

    spring: Value
    stiffer: Value
    """What the spring gains by a strain of 1."""
    drag: Value
    normals: Value


class SheetGraph:
    """The nodes' mechanics in a graph.

    Parameters
    ----------
    graph : receives the arrays.
    coefficients : (K, 1) of each of the nodes' coefficients that no shape changes, by name.
    coupled : (K, K) dt^2 C / 4, see `bridge.tissue.oscillators.coupling`.
    taps : shares of the load of a step, from the newest frame to the oldest.
    """

    def __init__(
        self,
        graph: ValueGraph,
        coefficients: Mapping[str, NDArray],
        coupled: NDArray,
        taps: Sequence[float],
    ) -> None:
        self._graph, self._taps = graph, list(map(float, taps))
        self._step_s = 1 / (STEPS * FPS)
        flat = {name: values[:, 0] for name, values in coefficients.items()}
        bound = np.abs(coupled).sum(1)
        with graph.section("sheet"):
            self._damping, self._inertia_gain, self._gravity_gain = (
                graph.array(name, flat[name])
                for name in ("damping_ratio", "inertia_gain", "gravity_gain")
            )
            self._beyond = graph.array("beyond", flat["normal_ratio"] - 1)
            self._bound = graph.array("bound", bound)
            self._own_pull = graph.array("own_pull", coupled.diagonal())
            self._pulled = graph.array("pulled", (np.diag(bound) - coupled).T)
            self._gravity = graph.array("gravity", GRAVITY_M_S2[:, None])

    def felt(self, acceleration: Value | None, columns: list[Value]) -> Value:
        """(B, 3, K) load m/s^2 of nodes that accelerate (B, 3, K); None where they stand still.

        `columns` are those of the rotations R that turn the nodes, (B, 3, K) each.
        """
        graph, hanging = self._graph, [self._gravity] * len(columns)
        # The rest frame's component y is column y of R times the vector.
        down = [(column * g).sum(1) for column, g in zip(columns, hanging, strict=True)]
        load = self._gravity_gain * (graph.concat(down, 1) - self._gravity)
        if acceleration is None:
            return load
        inertia = graph.concat([(column * acceleration).sum(1) for column in columns], 1)
        return load - self._inertia_gain * inertia

    def smoothed(self, felt: list[Value]) -> Value:
        """The load of a step from those of frames, the newest first."""
        first, *others = (tap * load for tap, load in zip(self._taps, felt, strict=True))
        for other in others:
            first = first + other
        return first

    def frame(self, person: Person, now: Value, before: Value, load: Value) -> tuple[Value, Value]:
        """Offsets (B, 3, K) a frame after `now`, and a step before that."""
        springs = self.springs(person)
        for _ in range(STEPS):
            before, now = now, self.step(springs, now, before, load)
        return now, before

    def settled(self, person: Person, load: Value) -> Value:
        """(B, 3, K) at rest under a constant load.

        Sweeps as in a step, with the strain that stiffens the springs followed by Newton's method.
        """
        springs = self.springs(person)
        pull, nothing = self._step_s**2 / 4 * load, 0.0 * load

        def sweep(offset_m: Value, strain: Value) -> tuple[Value, list[Value]]:
            spring = springs.spring + springs.stiffer * strain
            left = pull + offset_m @ self._pulled
            found_m = self._solved(left, self._bound + spring, self._beyond * spring, springs)
            reached = (found_m * self._stretched(found_m, springs)).sum(1)
            falls = 2.0 * reached * springs.stiffer / (spring + self._own_pull)
            followed = strain + (reached - strain) / (1.0 + falls)
            moved = self._graph.apply("Abs", found_m - offset_m).max(0, 1, 2)
            return (moved.reshape() > _SETTLED_M), [found_m, followed]

        return self._graph.repeat(_SETTLING, [nothing, nothing.part(1, 0, 1)], sweep)[0]

    def springs(self, person: Person) -> StepSprings:
        """A person's coefficients of one step."""
        spring = self._step_s**2 / 4 * person.omega * person.omega
        return StepSprings(
            spring,
            spring * person.stiffening,
            self._step_s * person.omega * self._damping,
            person.normals,
        )

    def step(self, springs: StepSprings, now: Value, before: Value, load: Value) -> Value:
        """Offsets (B, 3, K) a step after `now`, which followed `before`."""
        stretched = self._stretched(now, springs)
        stiffer = 2.0 * springs.stiffer * (now * stretched).sum(1)
        twice, after = 2.0 * now + before, 2.0 * now - before
        known = self._step_s**2 * load + after + springs.drag * before
        known = known - self._stretched(springs.spring * twice + stiffer * before, springs)
        known = known + twice @ self._pulled - self._bound * twice
        held = springs.spring + stiffer
        along = 1.0 + springs.drag + self._bound + held
        beyond = self._beyond * held
        for _ in range(SWEEPS):
            after = self._solved(known + after @ self._pulled, along, beyond, springs)
        return after

    def _stretched(self, offsets_m: Value, springs: StepSprings) -> Value:
        """P u."""
        outward = (offsets_m * springs.normals).sum(1)
        return offsets_m + self._beyond * outward * springs.normals

    def _solved(self, left: Value, along: Value, beyond: Value, springs: StepSprings) -> Value:
        """Each node's block, `along` I + `beyond` n n^T, inverted on `left`."""
        outward = (left * springs.normals).sum(1) * beyond / (along + beyond)
        return (left - outward * springs.normals) / along
