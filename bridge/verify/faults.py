"""The classical mistakes of a conversion, made on purpose: `verify` must find and name each.

A fault is given to one engine, PyTorch's: either wrong weights, as a wrong conversion would make
them, or an option that sets one constant of what the engine built.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import save_weights
from bridge.verify.checks import Plan, cases_of
from bridge.verify.protocol import Case

FAULTY = "torch"
FaultName = Literal[
    "gate_order",
    "batch_norm_epsilon",
    "dropped_bias",
    "transposed_recurrent_kernel",
    "transposed_kernel",
    "forgotten_mask",
    "inverted_momentum",
    "adam_epsilon",
]
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Fault:
    """One mistake."""

    named: str
    """Words of the diagnosis that name the place."""
    checks: tuple[str, ...]
    """The checks that show it soonest; the tests ask only these."""
    weights: Callable[[Arrays], Arrays] = dict
    """What it does to canonical weights."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What it sets in the engine."""


def _changed(prefix: str, change: Callable[[NDArray], NDArray]) -> Callable[[Arrays], Arrays]:
    """Change the arrays whose names begin so, wherever there are any."""
    return lambda arrays: {n: change(a) if n.startswith(prefix) else a for n, a in arrays.items()}


def _gates_swapped(array: NDArray) -> NDArray:
    """i, f, c, o read as i, c, f, o."""
    i, f, c, o = np.split(array, 4, axis=-1)
    return np.concatenate([i, c, f, o], axis=-1)


def _gates_transposed(array: NDArray) -> NDArray:
    """Each gate's own 60 x 60 block transposed: every shape is still right."""
    return np.concatenate([block.T for block in np.split(array, 4, axis=-1)], axis=-1)


FAULTS: dict[FaultName, Fault] = {
    "gate_order": Fault("layer lstm", ("dsnet-whole-clip",), _changed("lstm/", _gates_swapped)),
    "batch_norm_epsilon": Fault(
        "layer batch_norm", ("dsnet-whole-clip",), options={"batch_norm_epsilon": 1e-5}
    ),
    "dropped_bias": Fault(
        "layer fc_enc_2", ("dsnet-whole-clip",), _changed("fc_enc_2/bias", np.zeros_like)
    ),
    "transposed_recurrent_kernel": Fault(
        "layer lstm",
        ("dsnet-whole-clip",),
        _changed("lstm/recurrent_kernel", _gates_transposed),
    ),
    "transposed_kernel": Fault(
        "layer encoder.conv_2",
        ("ae-batch",),
        _changed("encoder.conv_2.weight", lambda kernel: kernel.swapaxes(0, 1)),
    ),
    "forgotten_mask": Fault(
        "layer batch_norm", ("dsnet-training-masked",), options={"forget_mask": True}
    ),
    "inverted_momentum": Fault(
        "statistics batch_norm/moving_mean",
        ("dsnet-training",),
        options={"batch_norm_momentum": 0.01},
    ),
    "adam_epsilon": Fault("Adam's update", ("dsnet-training",), options={"adam_epsilon": 1e-8}),
}


def shown_by_torch(plan: Plan) -> Plan:
    """The checks of a plan that the faulty engine computes from weights, and that engine only."""
    checks = [
        replace(check, engines={FAULTY: check.engines[FAULTY]})
        for check in plan.checks
        if FAULTY in check.engines and check.weights and check.op != "formats"
    ]
    return Plan(checks, plan.arrays)


def faulty_cases(plan: Plan, name: FaultName, request: Path) -> list[Case]:
    """The plan's cases, but the faulty engine's own copies carry the fault.

    The weights that it is given are written below `request`.
    """
    cases: list[Case] = []
    for case in cases_of(plan.checks):
        others = tuple(engine for engine in case.engines if engine != FAULTY)
        if others:
            cases.append(replace(case, engines=others))
        if FAULTY in case.engines:
            cases.append(_spoilt(case, plan, name, request))
    return cases


def _spoilt(case: Case, plan: Plan, name: FaultName, request: Path) -> Case:
    fault, spoilt_file = FAULTS[name], f"{name}-{case.weights_file}"
    if not (request / spoilt_file).exists():
        request.mkdir(parents=True, exist_ok=True)
        right = plan.arrays[case.weights_file.removesuffix(".safetensors")]
        save_weights(request / spoilt_file, fault.weights(right))
    options = {**case.options, "faults": dict(fault.options)}
    return replace(case, weights_file=spoilt_file, options=options, engines=(FAULTY,))
