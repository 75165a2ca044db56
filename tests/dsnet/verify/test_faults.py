"""Each planted mistake is found and located; without a mistake all checks pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dsnet.verify.compare import Row, diagnose, verify
from dsnet.verify.engines import ENGINES, Check, EngineResult, RunEngine, run_engine, write_requests
from tests.forged.faults import FAULTS, FAULTY, shown_by_torch, spoilt


@pytest.fixture(scope="module", params=["stand-in", "torch"])
def rows(
    request: pytest.FixtureRequest,
    run_reference: RunEngine,
    checks: list[Check],
    tmp_path_factory: pytest.TempPathFactory,
) -> list[Row]:
    """All faults in one process, by the reference in place of PyTorch and by PyTorch itself.

    Checks are named `<fault>:<check>`; those of no fault begin with `none:`.
    """
    folder = tmp_path_factory.mktemp("faults")
    whole = shown_by_torch(checks)
    right = faulty = _named(whole, "none", {fault.check for fault in FAULTS.values()})
    for name, fault in FAULTS.items():
        own = _named(whole, name, {fault.check})
        right, faulty = right + own, faulty + spoilt(own, name)
    run = run_engine if request.param == "torch" else run_reference

    def run_faulty(engine: str, request: Path, out: Path) -> EngineResult:
        if engine == FAULTY:
            request = folder / "spoilt"
            write_requests(request, {engine: faulty})
        return run(engine, request, out)

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ENGINES, FAULTY, "tests.forged.faulty_torch")
        return verify(right, folder, run_faulty)[0]


def _named(checks: list[Check], prefix: str, names: set[str]) -> list[Check]:
    chosen = [check for check in checks if check.name in names]
    return [replace(check, name=f"{prefix}:{check.name}") for check in chosen]


def test_no_fault_no_finding(rows):
    own = [row for row in rows if row.check.startswith("none:")]
    assert len(own) > 30
    assert diagnose(own) == {}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_found_and_named(rows, name):
    own = [row for row in rows if row.check.startswith(f"{name}:")]
    found = diagnose(own)
    assert found, "the fault went unseen"
    assert all(FAULTS[name].named in cause for cause in found), found
    assert {row.check for row in own if not row.passed} == {f"{name}:{FAULTS[name].check}"}
