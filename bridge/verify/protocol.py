"""How an engine is asked: one process, a folder of cases and arrays in, a folder of arrays out.

A case is one operation on one set of weights and inputs in one precision. Weights and inputs are
stored as float32, so every engine starts from the same numbers whatever it computes in.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.exchange import load_weights, save_weights
from bridge.installation import version_of
from bridge.processes import run_as_process
from bridge.runs.files import write_text_atomically

REQUEST = "request.json"
ANSWER = "engine.json"
DTypeName = Literal["float64", "float32"]
Tensors = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Case:
    """One operation for some engines."""

    name: str
    """Also the name of the file with its results."""
    op: str
    """What to compute."""
    dtype: DTypeName
    """What to compute it in."""
    engines: tuple[str, ...]
    """Who computes it."""
    weights_file: str = ""
    """Canonical weights, below the request's folder; none when empty."""
    inputs_file: str = ""
    """Inputs, below the request's folder; none when empty."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What the operation needs besides arrays."""
    folder: Path = Path()
    """The request's folder; known when it was read."""
    scratch: Path = Path()
    """Where the engine may write files of its own."""

    def weights(self) -> Tensors:
        """Canonical weights in the case's precision; integers stay what they are."""
        return self._load(self.weights_file)

    def inputs(self) -> Tensors:
        """Inputs in the case's precision; booleans stay what they are."""
        return self._load(self.inputs_file)

    def _load(self, name: str) -> Tensors:
        arrays = load_weights(self.folder / name) if name else {}
        exact = "bi"
        return {k: a if a.dtype.kind in exact else a.astype(self.dtype) for k, a in arrays.items()}


Operations = Mapping[str, Callable[[Case], Mapping[str, NDArray[Any]]]]


@dataclass(frozen=True)
class EngineConfig:
    """Compute the cases of a request that name this engine."""

    request: Path
    """Folder with `request.json`, weights and inputs."""
    out: Path
    """Folder to fill with one file a case, and `engine.json`."""
    engine: str
    """Which of a case's engines this process is."""


def write_request(folder: Path, cases: Sequence[Case]) -> None:
    """Write the list of cases; their files stand beside it already."""
    plain = [{k: v for k, v in asdict(c).items() if k not in ("folder", "scratch")} for c in cases]
    write_text_atomically(folder / REQUEST, json.dumps({"cases": plain}, indent=1) + "\n")


def read_request(config: EngineConfig) -> list[Case]:
    """The cases that name this engine, in the request's order."""
    cases = json.loads((config.request / REQUEST).read_text(encoding="utf-8"))["cases"]
    wanted = [Case(**{**case, "engines": tuple(case["engines"])}) for case in cases]
    return [
        replace(case, folder=config.request, scratch=config.out / "scratch" / case.name)
        for case in wanted
        if config.engine in case.engines
    ]


def serve(operations: Operations, packages: Sequence[str] = ()) -> None:
    """Be an engine: the `main` of its module.

    Parameters
    ----------
    operations : what computes each operation.
    packages : distributions whose versions are recorded.
    """
    run_as_process(EngineConfig, lambda config: _answer(config, operations, packages))


def _answer(config: EngineConfig, operations: Operations, packages: Sequence[str]) -> None:
    seconds: dict[str, float] = {}
    errors: dict[str, str] = {}
    order: dict[str, list[str]] = {}
    for case in read_request(config):
        started = time.perf_counter()
        case.scratch.mkdir(parents=True, exist_ok=True)
        try:
            tensors = operations[case.op](case)
        except Exception as error:
            # One engine's failure is a finding about that case, not the end of the others.
            errors[case.name] = " ".join(f"{type(error).__name__}: {error}".split())
            continue
        arrays = {name: np.atleast_1d(array) for name, array in tensors.items()}
        save_weights(config.out / f"{case.name}.safetensors", arrays)
        # A safetensors file sorts its names, and the first layer that differs is the one to name.
        order[case.name] = list(arrays)
        seconds[case.name] = round(time.perf_counter() - started, 3)
    versions = {package: version_of(package) for package in ("numpy", *packages)}
    answer = {"versions": versions, "seconds": seconds, "errors": errors, "order": order}
    write_text_atomically(config.out / ANSWER, json.dumps(answer, indent=1) + "\n")
