"""What is verified: each check is one operation, asked of several engines in their precisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bridge.exchange import save_weights
from bridge.exchange.weights import KERAS_ADAM, TORCH_ADAM
from bridge.verify.protocol import Case, DTypeName, write_request

REFERENCE = "numpy"
Engines = Mapping[str, tuple[DTypeName, ...]]
BOTH: tuple[DTypeName, ...] = ("float64", "float32")
FRAMEWORKS: Engines = {"torch": BOTH, "keras": BOTH}
WITH_ONNX: Engines = {**FRAMEWORKS, "onnx": ("float32",)}
FILES: Engines = {"torch": ("float32",), "keras": ("float32",), "onnx": ("float32",)}
IN_FLOAT64: Engines = {"torch": ("float64",), "keras": ("float64",)}
KERAS: Engines = {"keras": BOTH}
ONNX: Engines = {"onnx": ("float32",)}
STREAM: Engines = {"stream": ("float32",)}


@dataclass(frozen=True, eq=False)
class Check:
    """One operation on one set of numbers."""

    name: str
    """Unique; the table's first column."""
    op: str
    """As the engines know it."""
    engines: Engines
    """Which engines are compared with the reference, and in which precisions."""
    weights: str = ""
    """Name of a set of weights."""
    inputs: str = ""
    """Name of a set of inputs."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the operation needs besides arrays."""
    leave_out: tuple[str, ...] = ()
    """Tensors that are not compared, because the numbers do not define them."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Checks, and the arrays that they name."""

    checks: Sequence[Check]
    arrays: Mapping[str, Mapping[str, NDArray[Any]]]
    """Sets of weights and inputs by name."""

    def __add__(self, other: Plan) -> Plan:
        return Plan([*self.checks, *other.checks], {**self.arrays, **other.arrays})


def autoencoder_checks(
    name: str, weights: str, inputs: str, widths: tuple[int, ...], **architecture: Any
) -> list[Check]:
    """Forward pass and gradients of one autoencoder."""
    options = autoencoder_options(widths, **architecture)
    learning = {**options, "adam": asdict(TORCH_ADAM), "steps": []}
    return [
        Check(name, "ae_forward", WITH_ONNX, weights, inputs, {**options, "run": "whole"}),
        Check(f"{name}-gradients", "ae_train", FRAMEWORKS, weights, inputs, learning),
    ]


def autoencoder_options(
    widths: tuple[int, ...], activation: str = "leaky_relu", negative_slope: float = 0.1
) -> dict[str, Any]:
    """The part of an autoencoder's options that says which network it is."""
    architecture = {"widths": widths, "activation": activation, "negative_slope": negative_slope}
    return {"architecture": architecture}


def dsnet_graph_check(
    name: str, weights: str, inputs: str, body: str, **architecture: Any
) -> Check:
    """The deployable graph of DSNet and a decoder, from poses to the posed skin."""
    options = {"body": body, **autoencoder_options(**architecture)}
    return Check(name, "dsnet_graph", ONNX, weights, inputs, options)


def plus_graph_check(name: str, weights: str, inputs: str, body: str) -> Check:
    """The deployable graph of `dsnet_plus`, from poses to the posed skin."""
    return Check(name, "plus_graph", ONNX, weights, inputs, {"body": body})


def cases_of(checks: Sequence[Check]) -> list[Case]:
    """One case a check and precision; the reference answers each check once, in float64."""
    cases = []
    for check in checks:
        for dtype in BOTH:
            asked = [name for name, dtypes in check.engines.items() if dtype in dtypes]
            answered_by_arithmetic = dtype == "float64" and check.op != "formats"
            engines = (*((REFERENCE,) if answered_by_arithmetic else ()), *asked)
            if engines:
                cases.append(
                    Case(
                        case_name(check, dtype),
                        check.op,
                        dtype,
                        engines,
                        check.weights and f"{check.weights}.safetensors",
                        check.inputs and f"{check.inputs}.safetensors",
                        check.options,
                    )
                )
    return cases


def case_name(check: Check, dtype: DTypeName) -> str:
    """Name of a check's case in one precision."""
    return f"{check.name}.{dtype}"


def write_plan(folder: Path, plan: Plan, cases: Sequence[Case]) -> None:
    """Lay out a request: first the arrays that the plan's checks name, then the list of cases."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in {n for check in plan.checks for n in (check.weights, check.inputs) if n}:
        save_weights(folder / f"{name}.safetensors", plan.arrays[name])
    write_request(folder, cases)


def dsnet_training(
    name: str, weights: str, clips: str, masked: bool, steps: tuple[int, ...] = (1, 10)
) -> Check:
    """Training of DSNet by Keras's Adam."""
    options = {"masked": masked, "adam": asdict(KERAS_ADAM), "steps": steps}
    return Check(name, "dsnet_train", FRAMEWORKS, weights, clips, options)
