"""How the oscillators of `dsnet_plus` are trained, in float64: windows, loss, prior, gradient.

The gradient is found by steps into the imaginary direction, f'(x) = Im f(x + i h) / h: with h of
1e-30 nothing cancels, so it is exact to the last digits and needs no formula of its own.
"""

from __future__ import annotations

import numpy as np

from bridge.verify.reference.adam import Arrays, Pass
from bridge.verify.reference.oscillators import Coefficients, Sheet

NAMES = ("omega", "damping_ratio", "stiffening", "normal_ratio", "wave_speed", "bending",
         "inertia_gain", "gravity_gain")  # fmt: skip
_QUIET_M, _QUIET_SHARE = 2e-4, 0.3
_PRIOR = dict(zip(NAMES, (1e-4, 1e-2, 3e-3, 3e-3, 1e-2, 1e-2, 3e-2, 3e-2), strict=True))
"""Of nodes' deviations from all nodes' mean."""
_GAINS, _PEOPLE = 3e-2, 3e-3
"""Of gains that are not 1, and of what people have besides their shape's."""
_H = 1e-30


def predict(w: Arrays, given: Arrays) -> np.ndarray:
    """Offsets (T, K, B, 3) of B windows, from weights named as the Keras layer's and a batch."""
    taps, clips = w["taps"] / w["taps"].sum(), range(given["now"].shape[1])
    return np.stack([_window(w, given, taps, clip) for clip in clips], axis=2)


def learn(w: Arrays, given: Arrays) -> Pass:
    """Loss, and the gradient of it and the prior by every number of every weight."""
    gradients = {}
    for name, values in w.items():
        slopes = np.zeros(values.size)
        for place in range(values.size):
            moved = values.astype(np.complex128)
            moved.flat[place] += 1j * _H
            other = {**w, name: moved}
            total = _loss(predict(other, given), given) + _prior(other)
            slopes[place] = np.imag(total) / _H
        gradients[name] = slopes.reshape(values.shape)
    return Pass(float(_loss(predict(w, given), given)), gradients, {})


def _window(w: Arrays, given: Arrays, taps: np.ndarray, clip: int) -> np.ndarray:
    """(T, K, 3)."""
    own = given["features"][:, clip] @ w["slopes"]
    own = own + np.tensordot(given["shares"][clip], w["residual"], 1)  # (K, 1)
    logs = {name: w[f"log_{name}"] + w[f"by_node_{name}"] for name in NAMES}
    logs["omega"] = logs["omega"] + own
    logs["stiffening"] = logs["stiffening"] + w["stiffening_power"] * own
    normals = given["normals"][:, clip]
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    person = Coefficients(**{name: np.exp(log) for name, log in logs.items()}, normals=normals)
    felt = person.inertia_gain * given["inertia"][:, :, clip]
    felt = felt + person.gravity_gain * given["gravity"][:, :, clip]
    sheet, found = Sheet(person, given["laplacian"]), []
    now, before = given["now"][:, clip], given["before"][:, clip]
    for newest in range(len(taps) - 1, len(felt)):
        load = sum(tap * felt[newest - late] for late, tap in enumerate(taps))
        now, before = sheet.frame(now, before, np.asarray(load))
        found.append(now)
    return np.stack(found)


def _loss(found: np.ndarray, given: Arrays) -> np.ndarray:
    """The share of the energy that is missed, and some of each window's own share."""
    counted, target = given["counted"], given["target"]
    missed, energy = ((counted * values**2).mean((0, 1, 3)) for values in (found - target, target))
    quiet = counted.mean((0, 1, 3)) * _QUIET_M**2
    return missed.sum() / energy.sum() + _QUIET_SHARE * (missed / (energy + quiet)).mean()


def _prior(w: Arrays) -> np.ndarray:
    """Nodes are alike, people follow their shape, and gains are 1."""
    uneven = sum(weight * (w[f"by_node_{name}"] ** 2).mean() for name, weight in _PRIOR.items())
    gains = sum((w[f"log_{name}"] ** 2).sum() for name in ("inertia_gain", "gravity_gain"))
    return uneven + _GAINS * gains + _PEOPLE * (w["residual"] ** 2).mean()
