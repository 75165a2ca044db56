"""How an engine is called: one process for all its cases, a folder of arrays in, another out.

A request is `<engine>.json`, the list of its cases, and a file for each set of arrays; all
numbers in it are float32, so every engine starts from the same ones whatever it computes in. An
engine is functions `operation(weights, **inputs, **options)`, which give tensors by name, first
computed first. A case is one check in one precision.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import load_weights, save_weights
from bridge.installation import version_of

DTypeName = Literal["float64", "float32", "bfloat16"]
"""bfloat16: of products of matrices alone; all arrays are float32, and the operation is told."""
Tensors = dict[str, NDArray[Any]]
Operation = Callable[..., Tensors]

NORMALISER = ("normaliser.mean_m", "normaliser.scale_m")


def serve(
    *operations: Operation, packages: Iterable[str], here: Callable[[str], str] | None = None
) -> None:
    """Be an engine: what its module does as a process; `packages` are those that compute.

    `here` prepares for the engine of a name; if that cannot be on this machine, it says why.
    """
    engine, request, out = sys.argv[1:]
    named = {operation.__name__: operation for operation in operations}
    if missing := here(engine) if here else "":
        _write_answer(Path(out), missing=missing)
        return
    answer(engine, Path(request), Path(out), named, packages)


def answer(
    engine: str,
    request: Path,
    out: Path,
    operations: Mapping[str, Operation],
    packages: Iterable[str],
) -> None:
    """Compute an engine's cases of a request, and say how it went."""
    errors: dict[str, str] = {}
    for case in json.loads((request / f"{engine}.json").read_text(encoding="utf-8")):
        name = case["case"]
        weights, inputs = (
            _in_precision(load_tensors(request / case[kind]), case["dtype"]) if case[kind] else {}
            for kind in ("weights", "inputs")
        )
        given = [weights] if weights else []
        options = case["options"] | ({"bfloat16": True} if case["dtype"] == "bfloat16" else {})
        try:
            tensors = operations[case["op"]](*given, **inputs, **options)
        except Exception as error:
            # One engine's failure is a finding about that case, not the end of the others.
            errors[name] = " ".join(f"{type(error).__name__}: {error}".split())
            continue
        save_tensors(out / f"{name}.safetensors", tensors)
    versions = {package: version_of(package) for package in ("numpy", *packages)}
    _write_answer(out, versions=versions, errors=errors)


def _write_answer(out: Path, **facts: Any) -> None:
    (out / "answer.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")


def save_tensors(path: Path, tensors: Tensors) -> None:
    """Write tensors with numbers before their names, which a file sorts."""
    numbered = enumerate(tensors.items())
    save_weights(path, {f"{k:04d} {name}": np.atleast_1d(array) for k, (name, array) in numbered})


def load_tensors(path: Path) -> Tensors:
    return {name[5:]: array for name, array in sorted(load_weights(path).items())}


def _in_precision(arrays: Tensors, dtype: DTypeName) -> Tensors:
    of_arrays = "float64" if dtype == "float64" else "float32"
    return {n: a if a.dtype.kind in "bi" else a.astype(of_arrays) for n, a in arrays.items()}


def prefixed(prefix: str, arrays: Mapping[str, Any]) -> Tensors:
    """The same arrays under `<prefix>/<name>`."""
    return {f"{prefix}/{name}": np.asarray(array) for name, array in arrays.items()}


def joined(parts: Iterable[Mapping[str, Any]], axis: int = 0) -> Tensors:
    """Parts of every layer's output, put together and named as an engine returns them."""
    parts = list(parts)
    outputs = {name: np.concatenate([part[name] for part in parts], axis) for name in parts[0]}
    return prefixed("layer", outputs)


def batches(rows: NDArray, run: str) -> list[NDArray]:
    """The batch as a whole, or row by row where `run` is `singles`."""
    return np.split(rows, len(rows)) if run == "singles" else [rows]


def trained(
    steps: Sequence[int],
    first_pass: tuple[float, Tensors],
    step: Callable[[], float],
    state: Callable[[], Mapping[str, Tensors]],
) -> Tensors:
    """Loss and gradients of a first pass with the initial weights, and what each of `steps` leaves.

    `step` takes a step and gives the loss before it; `state` gives arrays of `weight`, and Adam's
    moments `adam_m` and `adam_v`, all under canonical names.
    """
    loss, gradients = first_pass
    dtype = next(iter(gradients.values())).dtype
    kept, losses = {"loss": np.array([loss], dtype), **prefixed("grad", gradients)}, []
    for count in range(1, max(steps, default=0) + 1):
        losses.append(step())
        if count in steps:
            for kind, arrays in state().items():
                kept |= prefixed(f"step_{count}/{kind}", arrays)
    return {**kept, "losses": np.array(losses, dtype)} if losses else kept
