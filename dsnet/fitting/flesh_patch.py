"""Constants of a model's soft regions, changes of them, and flesh that has them.

A region changes by three numbers: its frequency and damping ratio are multiplied, by the
exponentials of the first two; the third is the preload that its flesh takes on, as its `logit`.
Skin on bone stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from bridge.body import BodyModelData
from bridge.body.parts import PARTS, part_weights
from bridge.paper import FPS
from bridge.tissue.oscillators import GRAVITY_M_S2, STEPS, SWEEPS
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import SAG_POWER, TrainedPlus, shares_of_people

LEAST, MOST = 1.001, 2.85
"""Preloads, sag w^2 / g: 1 is a linear spring; at 3 weightless flesh has none."""
_BONE_HZ = 20.0
_SETTLING_STEPS = 120
_STEP_S = 1 / (STEPS * FPS)


def logit(preload: NDArray | float) -> NDArray[np.float64]:
    """Of the place of a preload between `LEAST` and `MOST`: a number without bounds."""
    inside = np.clip(preload, LEAST + 1e-3, MOST - 1e-3)
    return special.logit((inside - LEAST) / (MOST - LEAST))


def preload_of(logits: NDArray | float) -> NDArray[np.float64]:
    """The inverse of `logit`."""
    return LEAST + (MOST - LEAST) * special.expit(np.asarray(logits, np.float64))


def logit_slope(preload: float) -> float:
    """The derivative of `logit`."""
    return (MOST - LEAST) / ((preload - LEAST) * (MOST - preload))


@dataclass(frozen=True, eq=False)
class Region:
    """One part of a model's body: how much of a change each node takes, and what it is now."""

    there: NDArray[np.float64]
    """(K,) how far each node belongs to the part."""
    shares: NDArray[np.float64]
    """(K,) 1 in soft flesh of the part, 0 elsewhere and where skin lies on bone."""
    typical: NDArray[np.float64]
    """(K,) weights, which sum to 1, of the nodes that speak for the part: the soft ones."""

    @property
    def reach(self) -> float:
        """What part of a change the typical frequency and damping take."""
        return float(self.typical @ self.shares)

    @classmethod
    def of(cls, body: BodyModelData, model: TrainedPlus, part: str) -> Region:
        """The region of a part of the body."""
        there = part_weights(body)[model.nodes.vertices, PARTS.index(part)]
        omega = np.exp(model.weights.base["omega"][:, 0].astype(np.float64))
        typical = there**2 / omega**2
        typical /= typical.sum()
        bone, soft = np.log(2 * np.pi * _BONE_HZ), typical @ np.log(omega)
        softness = np.clip((bone - np.log(omega)) / max(bone - soft, 0.1), 0, 1)
        return cls(there, there * softness, typical)


def constants_of(
    body: BodyModelData, model: TrainedPlus, betas: NDArray
) -> dict[str, NDArray[np.float64]]:
    """(K,) of each of a model's node fields, of a person (10,)."""
    weights = model.weights
    own = shape_features(body, betas, model.nodes.vertices) @ weights.slopes
    own = own + np.tensordot(shares_of_people(betas, model.people_betas), weights.residual, 1)
    powers = weights.powers()
    return {
        name: np.exp((log + powers.get(name, 0.0) * own)[:, 0].astype(np.float64))
        for name, log in weights.base.items()
    }


def changed(
    base: Mapping[str, NDArray], shares: NDArray, normals: NDArray, sets: NDArray
) -> dict[str, NDArray[np.float64]]:
    """The node fields (K, M) that are fitted, of nodes that take their shares of M changes (M, 3).

    Parameters
    ----------
    base : (K,) of each of the model's node fields.
    normals : (K, 3).
    sets : logarithms of factors, and logits of preloads.
    """
    wide, part = {name: values[:, None] for name, values in base.items()}, shares[:, None]
    factor = np.exp(part * sets[:, 0])
    omega, preload = factor * wide["omega"], preload_of(sets[:, 2])
    taut = 1 + (wide["normal_ratio"] - 1) * normals[:, 1, None] ** 2
    sag_m = preload * -GRAVITY_M_S2[1] / omega**2
    stiffening = (preload - 1) / (3 - preload) / (sag_m**2 * taut)
    return {
        "omega": omega,
        "damping_ratio": wide["damping_ratio"] * np.exp(part * sets[:, 1]),
        "stiffening": (wide["stiffening"] * factor**4) ** (1 - part) * stiffening**part,
        "sag": (wide["sag"] / factor**2) ** (1 - part) * sag_m**part,
    }


def with_changes(
    body: BodyModelData,
    model: TrainedPlus,
    regions: Mapping[str, Region],
    changes: Mapping[str, ArrayLike],
) -> TrainedPlus:
    """A model whose regions have changed, by (3,) each."""
    logs = dict(model.weights.base)
    normals = shaped_normals(body, np.zeros(10))[model.nodes.vertices].astype(np.float64)
    for part, change in changes.items():
        base = {name: np.exp(log[:, 0].astype(np.float64)) for name, log in logs.items()}
        now = changed(base, regions[part].shares, normals, np.asarray(change)[None])
        logs |= {name: np.log(values).astype(np.float32) for name, values in now.items()}
    # The preload of flesh, a s^2, is then everybody's, whatever W each has: s falls with W^2.
    power = np.array([-2 * SAG_POWER], np.float32) if changes else model.weights.stiffening_power
    return replace(model, weights=replace(model.weights, base=logs, stiffening_power=power))


class Patch:
    """K nodes that move together, with M sets of constants at once: what a fit rolls.

    The steps are those of `bridge.tissue.oscillators`, in float64; motions and sets lie side by
    side, so that a derivative costs little more than one simulation. Inside, arrays are
    (K, 3, M, B) of B motions.

    Parameters
    ----------
    constants : (K, M) of each node field that is fitted, as `changed` gives them.
    coupled : (K, K) dt^2 C / 4.
    normals, normal_ratio : (K, 3) and (K,).
    """

    def __init__(
        self,
        constants: Mapping[str, NDArray],
        coupled: NDArray,
        normals: NDArray,
        normal_ratio: NDArray,
    ) -> None:
        def wide(values: NDArray) -> NDArray[np.float64]:
            return values[:, None, :, None]

        omega, sag_m = constants["omega"], constants["sag"]
        hanging = sag_m**2 * (1 + (normal_ratio[:, None] - 1) * normals[:, 1, None] ** 2)
        taut = constants["stiffening"] * hanging  # a |s|_P^2
        spring = _STEP_S**2 / 4 * omega**2 / (1 + 3 * taut)
        self._spring, self._standing = wide(spring), wide(2 * spring * taut)
        self._stiffer = wide(2 * spring * constants["stiffening"])
        self._hung = wide(2 * sag_m) * np.array([0.0, -1.0, 0.0])[:, None, None]
        self._drag = _STEP_S * wide(constants["damping_ratio"] * omega)
        self._heavy = _STEP_S * wide(omega)
        self._normals = normals[:, :, None, None]
        self._beyond = normal_ratio[:, None, None, None] - 1
        bound = np.abs(coupled).sum(axis=1)
        self._bound = bound[:, None, None, None]
        self._pulled = np.diag(bound) - np.asarray(coupled, np.float64)

    def roll(
        self, loads: Sequence[NDArray], reading: Sequence[NDArray]
    ) -> list[NDArray[np.float64]]:
        """Offsets (T, N, 3, M), metres, of each motion's markers, from rest under the first load.

        Parameters
        ----------
        loads : (T, K, 3) of each of B motions, m/s^2: what moves the frame after.
        reading : (N, K) weights of the nodes in each motion's N markers.
        """
        longest = max(map(len, loads))
        padded = [np.concatenate([f, f[-1:].repeat(longest - len(f), 0)]) for f in loads]
        given = np.stack(padded, axis=3)[:, :, :, None]  # (T, K, 3, 1, B)
        now = np.zeros((*given.shape[1:3], self._spring.shape[2], len(loads)))
        before = now
        for _ in range(_SETTLING_STEPS):
            before, now = now, self._step(now, before, given[0], self._heavy)
        before = now
        pairs = zip(loads, reading, strict=True)
        found = [np.zeros((len(load), len(weights), *now.shape[1:3])) for load, weights in pairs]
        for frame in range(longest):
            for motion, weights in enumerate(reading):
                if frame < len(found[motion]):
                    found[motion][frame] = np.tensordot(weights, now[..., motion], 1)
            for _ in range(STEPS):
                before, now = now, self._step(now, before, given[frame], self._drag)
        return found

    def _step(
        self, now: NDArray, before: NDArray, load: NDArray, drag: NDArray
    ) -> NDArray[np.float64]:
        """Offsets a step after `now`, which followed `before`."""
        strain = ((now + self._hung) * self._stretched(now)).sum(axis=1, keepdims=True)
        gained = self._stiffer * strain
        stiffer = self._standing + gained
        twice, after = 2 * now + before, 2 * now - before
        sheared = self._spring * twice + stiffer * before + gained * self._hung
        known = _STEP_S**2 * load + after + drag * before - self._stretched(sheared)
        known += self._pull(twice) - self._bound * twice
        held = self._spring + stiffer
        along = 1 + drag + self._bound + held
        beyond = self._beyond * held
        beyond = beyond / (along + beyond)
        for _ in range(SWEEPS):
            left = known + self._pull(after)
            outward = (left * self._normals).sum(axis=1, keepdims=True)
            after = (left - outward * beyond * self._normals) / along
        return after

    def _pull(self, offsets_m: NDArray) -> NDArray[np.float64]:
        return (self._pulled @ offsets_m.reshape(len(offsets_m), -1)).reshape(offsets_m.shape)

    def _stretched(self, offsets_m: NDArray) -> NDArray[np.float64]:
        outward = (offsets_m * self._normals).sum(axis=1, keepdims=True)
        return offsets_m + self._beyond * outward * self._normals
