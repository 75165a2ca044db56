"""The engines, the checks they run, and how to run one in a process of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bridge.exchange.engine import DTypeName, Tensors, save_tensors
from bridge.processes import outcome_of_module

REFERENCE = "numpy"
ENGINES = {
    REFERENCE: "dsnet.verify.reference.engine",
    "torch": "torch_align_ae.verify",
    "keras": "tf_dsnet.verify",
    "torch-gpu": "torch_align_ae.verify",
    "keras-gpu": "tf_dsnet.verify",
    "onnx": "dsnet.verify.deployed",
    "stream": "dsnet.verify.deployed",
}
GPUS = ("torch-gpu", "keras-gpu")
"""Engines that need one."""
_GPU_DRIVERS = ("dev/nvidia[0-9]*", "dev/kfd", "dev/dxg")
"""Files of the drivers of NVIDIA, AMD and, under Windows, WSL."""


@dataclass(frozen=True, eq=False)
class Check:
    """One operation on one set of arrays."""

    name: str
    op: str
    """Name of the function that each engine has for it."""
    engines: Mapping[str, Sequence[DTypeName]]
    """Engines that are compared with the reference, and in which precisions."""
    weights: Tensors = field(default_factory=dict)
    inputs: Tensors = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    """Other arguments of the operation."""
    leave_out: Sequence[str] = ()
    """Tensors that are not compared, because these inputs do not define them."""

    def precisions(self, engine: str) -> Sequence[DTypeName]:
        """Precisions in which an engine runs the check; the reference runs in float64."""
        return ("float64",) if engine == REFERENCE else self.engines.get(engine, ())


def write_requests(folder: Path, checks_of: Mapping[str, Iterable[Check]]) -> None:
    """Write each engine's checks to a folder; arrays that checks share are written once."""
    folder.mkdir(parents=True)
    files: dict[int, str] = {}

    def file_of(arrays: Tensors) -> str:
        if not arrays:
            return ""
        if id(arrays) not in files:
            files[id(arrays)] = f"{len(files)}.safetensors"
            save_tensors(folder / files[id(arrays)], arrays)
        return files[id(arrays)]

    for engine, checks in checks_of.items():
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
class EngineResult:
    """Results of an engine; `folder` has one file of tensors per case."""

    folder: Path
    versions: Mapping[str, str] = field(default_factory=dict)
    """Of packages, by name."""
    errors: Mapping[str, str] = field(default_factory=dict)
    """Why a case has no file, by case."""
    failure: str = ""
    """Why the whole process failed, in one line; empty if it did not."""
    missing: str = ""
    """Why this machine cannot have the engine, so that nothing is compared; empty if it can."""

    def path(self, check: Check, dtype: DTypeName) -> Path:
        return self.folder / f"{check.name}.{dtype}.safetensors"

    def why_missing(self, check: Check, dtype: DTypeName) -> str:
        """Why a check has no tensors; empty if it has."""
        if self.path(check, dtype).is_file() and not self.failure:
            return ""
        error = self.errors.get(f"{check.name}.{dtype}")
        return error or self.failure or "the engine left this case out"


RunEngine = Callable[[str, Path, Path], EngineResult]
"""A function of an engine's name, the folder of requests and the folder of its results."""


def run_engine(engine: str, request: Path, out: Path) -> EngineResult:
    """Run one engine as a process; if it crashes, the result has the reason as its `failure`."""
    out.mkdir(parents=True)
    if engine in GPUS and not any(any(Path("/").glob(driver)) for driver in _GPU_DRIVERS):
        return EngineResult(out, missing="no GPU")  # TensorFlow takes seconds to say so
    status, output = outcome_of_module(ENGINES[engine], engine, str(request), str(out))
    if status:
        last = (output.strip().splitlines() or ["without output"])[-1]
        return EngineResult(out, failure=f"the process ended with {status}: {last}")
    return EngineResult(out, **json.loads((out / "answer.json").read_text(encoding="utf-8")))
