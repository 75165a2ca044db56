"""Constants of a model's soft regions, changes of them, and a simulation of the changed tissue.

Three numbers change a region: its frequency and damping ratio are multiplied by the exponentials of
the first two, the third is the `logit` of its preload. Skin over bone does not change.
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
"""Bounds of the preload, sag w^2 / g: 1 is a linear spring, 3 would need infinite stiffening."""
_BONE_HZ = 20.0
_SETTLING_STEPS = 120
_STEP_S = 1 / (STEPS * FPS)


def logit(preload: NDArray | float) -> NDArray[np.float64]:
    """The logit of a preload's position between `LEAST` and `MOST`: a number without bounds."""
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
    """The nodes of one part of the body, by weights."""

    weights: NDArray[np.float64]
    """(K,) how far each node belongs to the part."""
    softness: NDArray[np.float64]
    """(K,) how much of a change each node takes on: 1 in soft tissue of the part, 0 elsewhere and
    where skin lies on bone."""
    typical: NDArray[np.float64]
    """(K,) weights, which sum to 1, of the average over the part, mainly over its soft nodes."""

    @property
    def reach(self) -> float:
        """How much of a change the average frequency and damping take on."""
        return float(self.typical @ self.softness)

    @classmethod
    def of(cls, body: BodyModelData, model: TrainedPlus, part: str) -> Region:
        """The region of a part of the body."""
        weights = part_weights(body)[model.nodes.vertices, PARTS.index(part)]
        omega = np.exp(model.weights.base["omega"][:, 0].astype(np.float64))
        typical = weights**2 / omega**2
        typical /= typical.sum()
        bone, soft = np.log(2 * np.pi * _BONE_HZ), typical @ np.log(omega)
        softness = np.clip((bone - np.log(omega)) / max(bone - soft, 0.1), 0, 1)
        return cls(weights, weights * softness, typical)


def constants_of(
    body: BodyModelData, model: TrainedPlus, betas: NDArray
) -> dict[str, NDArray[np.float64]]:
    """A model's node fields (K,) by name, for betas (10,)."""
    weights = model.weights
    log_omega = shape_features(body, betas, model.nodes.vertices) @ weights.slopes
    shares = shares_of_people(betas, model.people_betas)
    log_omega = log_omega + np.tensordot(shares, weights.residual, 1)
    powers = weights.powers()
    return {
        name: np.exp((log + powers.get(name, 0.0) * log_omega)[:, 0].astype(np.float64))
        for name, log in weights.base.items()
    }


def changed(
    base: Mapping[str, NDArray], softness: NDArray, normals: NDArray, sets: NDArray
) -> dict[str, NDArray[np.float64]]:
    """The fitted node fields (K, M) for M sets of changes.

    Parameters
    ----------
    base : (K,) of each of the model's node fields.
    softness : (K,) how much of a change each node takes on, see `Region`.
    normals : (K, 3).
    sets : (M, 3) logarithms of two factors, and logit of the preload.
    """
    wide, part = {name: values[:, None] for name, values in base.items()}, softness[:, None]
    factor = np.exp(part * sets[:, 0])
    omega, preload = factor * wide["omega"], preload_of(sets[:, 2])
    vertical = 1 + (wide["normal_ratio"] - 1) * normals[:, 1, None] ** 2  # of P
    sag_m = preload * -GRAVITY_M_S2[1] / omega**2
    stiffening = (preload - 1) / (3 - preload) / (sag_m**2 * vertical)
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
    """A model with changes (3,) of its regions, by part."""
    logs = dict(model.weights.base)
    normals = shaped_normals(body, np.zeros(10))[model.nodes.vertices].astype(np.float64)
    for part, change in changes.items():
        base = {name: np.exp(log[:, 0].astype(np.float64)) for name, log in logs.items()}
        fields = changed(base, regions[part].softness, normals, np.asarray(change)[None])
        logs |= {name: np.log(values).astype(np.float32) for name, values in fields.items()}
    # Make the preload, which depends on a s^2, the same for all subjects whatever their W: the sag
    # s falls with W^2, so the stiffening a has to rise with twice that power.
    power = np.array([-2 * SAG_POWER], np.float32) if changes else model.weights.stiffening_power
    return replace(model, weights=replace(model.weights, base=logs, stiffening_power=power))


class Patch:
    """Simulates K coupled nodes with M sets of constants for B motions at once, in float64.

    The steps are those of `bridge.tissue.oscillators`. Simulating sets together makes a derivative
    cost little more than one simulation. Internal arrays are (K, 3, M, B).

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
        sag_squared = sag_m**2 * (1 + (normal_ratio[:, None] - 1) * normals[:, 1, None] ** 2)
        strain = constants["stiffening"] * sag_squared  # a |s|_P^2
        spring = _STEP_S**2 / 4 * omega**2 / (1 + 3 * strain)
        self._spring, self._preload = wide(spring), wide(2 * spring * strain)
        self._cubic = wide(2 * spring * constants["stiffening"])
        self._twice_sag = wide(2 * sag_m) * np.array([0.0, -1.0, 0.0])[:, None, None]
        self._drag = _STEP_S * wide(constants["damping_ratio"] * omega)
        self._critical_drag = _STEP_S * wide(omega)
        self._normals = normals[:, :, None, None]
        self._anisotropy = normal_ratio[:, None, None, None] - 1
        bound = np.abs(coupled).sum(axis=1)
        self._bound = bound[:, None, None, None]
        self._neighbours = np.diag(bound) - np.asarray(coupled, np.float64)

    def simulate(
        self, loads: Sequence[NDArray], node_weights: Sequence[NDArray]
    ) -> list[NDArray[np.float64]]:
        """Offsets (T, N, 3, M) of each motion's markers, metres, from rest under the first load.

        Parameters
        ----------
        loads : (T, K, 3) of each of B motions, m/s^2; a frame's load moves the nodes to the next.
        node_weights : (N, K) interpolation weights of the nodes at each motion's N markers.
        """
        longest = max(map(len, loads))
        padded = [np.concatenate([f, f[-1:].repeat(longest - len(f), 0)]) for f in loads]
        load = np.stack(padded, axis=3)[:, :, :, None]  # (T, K, 3, 1, B)
        now = np.zeros((*load.shape[1:3], self._spring.shape[2], len(loads)))
        before = now
        for _ in range(_SETTLING_STEPS):
            before, now = now, self._step(now, before, load[0], self._critical_drag)
        before = now
        pairs = zip(loads, node_weights, strict=True)
        offsets_m = [np.zeros((len(one), len(weights), *now.shape[1:3])) for one, weights in pairs]
        for frame in range(longest):
            for motion, weights in enumerate(node_weights):
                if frame < len(offsets_m[motion]):
                    offsets_m[motion][frame] = np.tensordot(weights, now[..., motion], 1)
            for _ in range(STEPS):
                before, now = now, self._step(now, before, load[frame], self._drag)
        return offsets_m

    def _step(
        self, now: NDArray, before: NDArray, load: NDArray, drag: NDArray
    ) -> NDArray[np.float64]:
        """Offsets one step after `now`, which follows `before`."""
        strain = ((now + self._twice_sag) * self._times_p(now)).sum(axis=1, keepdims=True)
        stiffening = self._cubic * strain
        stiffness = self._preload + stiffening
        twice, after = 2 * now + before, 2 * now - before
        elastic = self._spring * twice + stiffness * before + stiffening * self._twice_sag
        known = _STEP_S**2 * load + after + drag * before - self._times_p(elastic)
        known += self._from_neighbours(twice) - self._bound * twice
        # Each node's matrix is `tangential` I + `normal` n n^T, inverted in closed form.
        implicit = self._spring + stiffness
        tangential, normal = 1 + drag + self._bound + implicit, self._anisotropy * implicit
        fraction = normal / (tangential + normal)
        for _ in range(SWEEPS):
            right_side = known + self._from_neighbours(after)
            outward = (right_side * self._normals).sum(axis=1, keepdims=True)
            after = (right_side - outward * fraction * self._normals) / tangential
        return after

    def _from_neighbours(self, offsets_m: NDArray) -> NDArray[np.float64]:
        return (self._neighbours @ offsets_m.reshape(len(offsets_m), -1)).reshape(offsets_m.shape)

    def _times_p(self, offsets_m: NDArray) -> NDArray[np.float64]:
        """P u."""
        outward = (offsets_m * self._normals).sum(axis=1, keepdims=True)
        return offsets_m + self._anisotropy * outward * self._normals
