"""The real thing: every engine in its process, on each of its operations, and no row that fails.

The command asks them all cases in `tests/end_to_end/test_whole_runs.py`.
"""

from __future__ import annotations

import pytest

from dsnet.verify.compare import diagnose, skipped_rows, verify
from dsnet.verify.engines import ENGINES, GPUS, REFERENCE
from dsnet.verify.single_checks import FRAMEWORKS

OF_EACH_OPERATION = (
    "dsnet-whole-clip",
    "dsnet-training",
    "dsnet-training-masked",
    "dsnet-fit",
    "dsnet-keras",
    "dsnet-savedmodel",
    "dsnet-tflite",
    "dsnet-stream",
    "dsnet-stream-large",
    "dsnet-graph",
    "plus-graph",
    "ae-batch",
    "ae-training",
    "ae-bfloat16",
    "ae-bfloat16-training",
    "ae-decoder",
    "smpl-moderate",
    "align-pose",
    "align-shape",
    "oscillators",
    "soft-tissue",
    "soft-tissue-slopes",
)


@pytest.fixture(scope="module")
def few(checks):
    return [check for check in checks if check.name in OF_EACH_OPERATION]


@pytest.fixture(scope="module")
def found(few, tmp_path_factory):
    rows, answers = verify(few, tmp_path_factory.mktemp("verify"))
    assert not any(answer.failure or answer.errors for answer in answers.values())
    return rows, skipped_rows(few, answers)


@pytest.fixture(scope="module")
def rows(found):
    return found[0]


def test_all_engines_agree_with_the_reference(rows):
    assert [row for row in rows if not row.passed] == []
    assert diagnose(rows) == {}


def test_each_operation_of_each_engine_is_asked_and_has_its_row(found, few, checks):
    rows, skipped = found
    asked, known = (
        {(check.op, engine) for check in which for engine in check.engines}
        for which in (few, checks)
    )
    assert asked == known
    assert {engine for _, engine in known} == {*ENGINES} - {REFERENCE}
    assert {one.engine for one in skipped} in (set(), {*GPUS})
    assert {(row.check, row.engine, row.dtype) for row in [*rows, *skipped]} == {
        (check.name, engine, dtype)
        for check in few
        for engine in check.engines
        for dtype in check.precisions(engine)
    }


def test_differences_are_real_numbers_and_float32_differs(rows):
    """Engines that gave the reference back, or one another's precision, would differ by nothing."""
    layers = [row for row in rows if row.part == "layers"]
    single = [row.max_rel for row in layers if row.dtype == "float32"]
    double = [row.max_rel for row in layers if row.dtype == "float64"]
    half = [row.max_rel for row in layers if row.dtype == "bfloat16"]
    assert min(half) > 1e-4
    assert min(single) > 1e-9 > max(double)
    assert {row.engine for row in layers if row.max_rel > 0} >= FRAMEWORKS.keys()
