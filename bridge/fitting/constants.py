"""Constants of a model's soft regions, and changes of them: three numbers a region.

A region's frequency and damping ratio are multiplied, by the exponentials of the first two; the
third is the preload that its flesh takes on, as its `logit`. Skin on bone stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from bridge.body import BodyModelData
from bridge.body.parts import PARTS, part_weights
from bridge.fitting.hanging import Constants
from bridge.tissue.oscillators import GRAVITY_M_S2
from bridge.tissue.shape import shape_features, shaped_normals
from bridge.tissue.trained_plus import SAG_POWER, TrainedPlus, shares_of_people

LEAST, MOST = 1.001, 2.85
"""Preloads, sag w^2 / g: 1 is a linear spring; at 3 weightless flesh has none."""
_BONE_HZ = 20.0


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
        return cls(there * softness, typical)


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
) -> Constants:
    """The constants (K, M) of nodes that take their shares of M changes (M, 3).

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
    return Constants(
        omega,
        wide["damping_ratio"] * np.exp(part * sets[:, 1]),
        (wide["stiffening"] * factor**4) ** (1 - part) * stiffening**part,
        (wide["sag"] / factor**2) ** (1 - part) * sag_m**part,
    )


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
        logs |= {name: np.log(values).astype(np.float32) for name, values in vars(now).items()}
    # The preload of flesh, a s^2, is then everybody's, whatever W each has: s falls with W^2.
    power = np.array([-2 * SAG_POWER], np.float32) if changes else model.weights.stiffening_power
    return replace(model, weights=replace(model.weights, base=logs, stiffening_power=power))
