"""Runs the engines on a plan and compares each with the reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

from numpy.typing import NDArray
from safetensors import safe_open

from bridge.runs.workers import progress
from bridge.verify.checks import REFERENCE, Check, Plan, case_name, cases_of, write_plan
from bridge.verify.compare import Read, Row, compare, compare_files, missing_row
from bridge.verify.engines import Answer, Ask, ask
from bridge.verify.protocol import Case, DTypeName

FILE_FORMATS = {
    "torch": ("memory", "safetensors", "state_dict"),
    "keras": ("memory", "safetensors", "keras"),
    "onnx": ("onnx",),
}
"""What each engine writes and reads back."""


def verify(
    plan: Plan, folder: Path, cases: list[Case] | None = None, run_engine: Ask = ask
) -> tuple[list[Row], dict[str, Answer]]:
    """All rows of a plan, and what the engines said.

    Parameters
    ----------
    plan : what to check.
    folder : an empty folder for the request and the answers; the caller removes it.
    cases : in place of the plan's own, when a fault is to be found.
    run_engine : asks one engine.
    """
    cases = cases_of(plan.checks) if cases is None else cases
    request = folder / "request"
    write_plan(request, plan, cases)
    engines = list(dict.fromkeys(engine for case in cases for engine in case.engines))
    bar = progress(engines, what="engines", unit="engine")
    answers = {engine: run_engine(engine, request, folder / engine) for engine in bar}
    rows = [
        row
        for check in plan.checks
        for engine, dtypes in check.engines.items()
        for dtype in dtypes
        for row in rows_of(check, engine, dtype, answers, request)
    ]
    return rows, answers


def rows_of(
    check: Check, engine: str, dtype: DTypeName, answers: Mapping[str, Answer], request: Path
) -> Iterator[Row]:
    """Compare one engine's answer to one case."""
    case = case_name(check, dtype)
    if case not in answers[engine].order:
        yield missing_row(check.name, engine, dtype, answers[engine].why_missing(case))
        return
    with ExitStack() as stack:
        found = TensorFile(stack, answers[engine].folder / f"{case}.safetensors")
        if check.op == "formats":
            expected = TensorFile(stack, request / f"{check.weights}.safetensors")
            yield _files_row(check, engine, dtype, expected, found)
            return
        reference, name = answers[REFERENCE], case_name(check, "float64")
        if name not in reference.order:
            yield missing_row(check.name, REFERENCE, "float64", reference.why_missing(name))
            return
        names = [n for n in reference.order[name] if n not in check.leave_out]
        expected = TensorFile(stack, reference.folder / f"{name}.safetensors")
        yield from compare(check.name, engine, dtype, names, expected, found)


def _files_row(
    check: Check, engine: str, dtype: DTypeName, expected: TensorFile, found: Read
) -> Row:
    prefixes = [f"weight/{name}/" for name in FILE_FORMATS[engine]]
    names = [prefix + name for prefix in prefixes for name in expected.names]

    def original(name: str) -> NDArray | None:
        return expected(name.split("/", 2)[2])

    return compare_files(check.name, engine, dtype, names, original, found)


class TensorFile:
    """Tensors of one file, one at a time: the largest files hold 270 MB."""

    def __init__(self, stack: ExitStack, path: Path) -> None:
        self._file = stack.enter_context(safe_open(path, framework="numpy"))
        self.names = list(self._file.keys())

    def __call__(self, name: str) -> NDArray | None:
        """One tensor, or None if there is none of that name."""
        return self._file.get_tensor(name) if name in self.names else None
