"""The classical mistakes of a conversion, made on purpose: `verify` must find and name each.

A fault is given to one engine, PyTorch's (`faulty_torch.py`): either wrong weights, as a wrong
conversion would make them, or an option that sets one constant of what the engine builds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.exchange.engine import Tensors
from dsnet.verify.engines import Check

FAULTY = "torch"


class Fault(NamedTuple):
    """One mistake."""

    named: str
    """Words of the diagnosis that name the place."""
    check: str
    """That shows it soonest; the tests ask only this."""
    weights: Callable[[Tensors], Tensors] = dict
    """What it does to canonical weights."""
    options: Mapping[str, Any] = {}
    """What it sets in the engine."""


def _changed(prefix: str, change: Callable[[NDArray], NDArray]) -> Callable[[Tensors], Tensors]:
    """Change the arrays whose names begin so, wherever there are any."""
    return lambda arrays: {n: change(a) if n.startswith(prefix) else a for n, a in arrays.items()}


def _gates_swapped(array: NDArray) -> NDArray:
    """i, f, c, o read as i, c, f, o."""
    i, f, c, o = np.split(array, 4, axis=-1)
    return np.concatenate([i, c, f, o], axis=-1)


def _gates_transposed(array: NDArray) -> NDArray:
    """Each gate's own 60 x 60 block transposed: every shape is still right."""
    return np.concatenate([block.T for block in np.split(array, 4, axis=-1)], axis=-1)


_CLIP, _TRAINING = "dsnet-whole-clip", "dsnet-training"
_RECURRENT, _SQUARE = "lstm/recurrent_kernel", "encoder.conv_2.weight"
FAULTS: dict[str, Fault] = {
    "gate_order": Fault("layer lstm", _CLIP, _changed("lstm/", _gates_swapped)),
    "batch_norm_epsilon": Fault("layer batch_norm", _CLIP, options={"batch_norm_epsilon": 1e-5}),
    "dropped_bias": Fault("layer fc_enc_2", _CLIP, _changed("fc_enc_2/bias", np.zeros_like)),
    "transposed_recurrent_kernel": Fault(
        "layer lstm", _CLIP, _changed(_RECURRENT, _gates_transposed)
    ),
    "transposed_kernel": Fault(
        "layer encoder.conv_2", "ae-batch", _changed(_SQUARE, lambda kernel: kernel.swapaxes(0, 1))
    ),
    "forgotten_mask": Fault(
        "layer batch_norm", "dsnet-training-masked", options={"forget_mask": True}
    ),
    "inverted_momentum": Fault(
        "statistics batch_norm/moving_mean", _TRAINING, options={"batch_norm_momentum": 0.01}
    ),
    "adam_epsilon": Fault("Adam's update", _TRAINING, options={"adam_epsilon": 1e-8}),
}


def shown_by_torch(checks: Iterable[Check]) -> list[Check]:
    """Those that the faulty engine computes from weights, and that engine only."""
    return [
        replace(check, engines={FAULTY: check.engines[FAULTY]})
        for check in checks
        if FAULTY in check.engines and check.weights
    ]


def spoilt(checks: Iterable[Check], name: str) -> list[Check]:
    """The checks with a fault: what the faulty engine is asked in their place."""
    fault = FAULTS[name]
    return [
        replace(
            check,
            weights=fault.weights(check.weights),
            options={**check.options, "faults": dict(fault.options)},
        )
        for check in checks
    ]
