"""The engines by name, what each is asked, and what it answers, in a process of its own."""

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
