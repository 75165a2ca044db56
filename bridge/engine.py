"""How an engine is asked: one process for all its cases, a folder of arrays in, another out.

A request is `<engine>.json`, the list of its cases, and a file for each set of arrays; all
numbers in it are float32, so every engine starts from the same ones whatever it computes in. An
engine is functions `operation(weights, **inputs, **options)`, which give tensors by name, first
computed first. A case is one check in one precision.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import load_weights, save_weights
from bridge.installation import version_of
from bridge.processes import outcome_of_module

DTypeName = Literal["float64", "float32"]
Tensors = dict[str, NDArray[Any]]
Operation = Callable[..., Tensors]

NORMALISER = ("normaliser.mean_m", "normaliser.scale_m")
REFERENCE = "numpy"
ENGINES = {
    REFERENCE: "dsnet.verify.reference.engine",
    "torch": "torch_align_ae.verify",
    "keras": "tf_dsnet.verify",
    "onnx": "dsnet.verify.deployed",
    "stream": "dsnet.verify.deployed",
}


@dataclass(frozen=True, eq=False)
class Check:
    """One operation on one set of numbers."""

    name: str
    op: str
    """Name of the engines' function."""
    engines: Mapping[str, Sequence[DTypeName]]
    """Which engines are compared with the reference, and in which precisions."""
    weights: Tensors = field(default_factory=dict)
    inputs: Tensors = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the operation needs besides arrays."""
    leave_out: Sequence[str] = ()
    """Tensors that are not compared, because the numbers do not define them."""

    def precisions(self, engine: str) -> Sequence[DTypeName]:
        """In which an engine is asked for it; the reference once."""
        return ("float64",) if engine == REFERENCE else self.engines.get(engine, ())


def write_requests(folder: Path, asked: Mapping[str, Iterable[Check]]) -> None:
    """What each engine is asked; a set of arrays that checks share lies there once."""
    folder.mkdir(parents=True)
    files: dict[int, str] = {}

    def file_of(arrays: Tensors) -> str:
        if not arrays:
            return ""
        if id(arrays) not in files:
            files[id(arrays)] = f"{len(files)}.safetensors"
            save_tensors(folder / files[id(arrays)], arrays)
        return files[id(arrays)]

    for engine, checks in asked.items():
        cases = [
            {
                "case": f"{check.name}.{dtype}",
                "op": check.op,
                "dtype": dtype,
                "weights": file_of(check.weights),
                "inputs": file_of(check.inputs),
                "options": check.options,
            }
            for check in checks
            for dtype in check.precisions(engine)
        ]
        (folder / f"{engine}.json").write_text(json.dumps(cases, indent=1), encoding="utf-8")


@dataclass(frozen=True)
class Answer:
    """What an engine said; its tensors lie in `folder`, one file a case."""

    folder: Path
    versions: Mapping[str, str]
    errors: Mapping[str, str]
    """By case: why there is no file."""
    failure: str = ""
    """Why the process as a whole gave nothing, in one line."""

    def path(self, check: Check, dtype: DTypeName) -> Path:
        return self.folder / f"{check.name}.{dtype}.safetensors"

    def why_missing(self, check: Check, dtype: DTypeName) -> str:
        """Why there is no such file; empty if there is."""
        if self.path(check, dtype).is_file() and not self.failure:
            return ""
        said = self.errors.get(f"{check.name}.{dtype}")
        return said or self.failure or "the engine left this case out"


Ask = Callable[[str, Path, Path], Answer]


def ask(engine: str, request: Path, out: Path) -> Answer:
    """Run one engine on a request; an engine that dies is an answer too."""
    out.mkdir(parents=True)
    status, said = outcome_of_module(ENGINES[engine], engine, str(request), str(out))
    if status:
        last = (said.strip().splitlines() or ["and said nothing"])[-1]
        return Answer(out, {}, {}, f"the process ended with {status}: {last}")
    return Answer(out, **json.loads((out / "answer.json").read_text(encoding="utf-8")))


def serve(*operations: Operation, packages: Iterable[str]) -> None:
    """Be an engine: what its module does as a process; `packages` are those that compute."""
    engine, request, out = sys.argv[1:]
    named = {operation.__name__: operation for operation in operations}
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
        try:
            tensors = operations[case["op"]](*given, **inputs, **case["options"])
        except Exception as error:
            # One engine's failure is a finding about that case, not the end of the others.
            errors[name] = " ".join(f"{type(error).__name__}: {error}".split())
            continue
        save_tensors(out / f"{name}.safetensors", tensors)
    versions = {package: version_of(package) for package in ("numpy", *packages)}
    said = json.dumps({"versions": versions, "errors": errors}, indent=1)
    (out / "answer.json").write_text(said, encoding="utf-8")


def save_tensors(path: Path, tensors: Tensors) -> None:
    """Write tensors with numbers before their names, which a file sorts."""
    numbered = enumerate(tensors.items())
    save_weights(path, {f"{k:04d} {name}": np.atleast_1d(array) for k, (name, array) in numbered})


def load_tensors(path: Path) -> Tensors:
    return {name[5:]: array for name, array in sorted(load_weights(path).items())}


def _in_precision(arrays: Tensors, dtype: DTypeName) -> Tensors:
    return {n: a if a.dtype.kind in "bi" else a.astype(dtype) for n, a in arrays.items()}


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
