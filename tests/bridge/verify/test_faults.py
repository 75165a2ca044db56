"""Each classical mistake is found and its place named; the plan without a mistake passes."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import pytest

from bridge.verify.checks import Plan, cases_of
from bridge.verify.compare import Row
from bridge.verify.engines import Ask, ask
from bridge.verify.faults import FAULTS, FaultName, faulty_cases, shown_by_torch
from bridge.verify.findings import diagnose
from bridge.verify.random_checks import random_plan
from bridge.verify.runner import verify


def test_every_fault_has_a_name():
    assert set(FAULTS) == set(get_args(FaultName))


@pytest.fixture(scope="module", params=["stand-in", "torch"])
def rows(
    request: pytest.FixtureRequest, ask_reference: Ask, tmp_path_factory: pytest.TempPathFactory
) -> list[Row]:
    """All faults in one process, by the reference in place of PyTorch and by PyTorch itself.

    Checks are named `<fault>:<check>`; those of no fault begin with `none:`.
    """
    folder = tmp_path_factory.mktemp("faults")
    whole = shown_by_torch(random_plan(0, "embedded:female"))
    soonest = {check for fault in FAULTS.values() for check in fault.checks}
    plan = _named(whole, "none", soonest)
    cases = cases_of(plan.checks)
    for name, fault in FAULTS.items():
        spoilt = _named(whole, name, set(fault.checks))
        cases += faulty_cases(spoilt, name, folder / "request")
        plan = plan + spoilt
    return verify(plan, folder, cases, ask if request.param == "torch" else ask_reference)[0]


def _named(plan: Plan, prefix: str, names: set[str]) -> Plan:
    checks = [check for check in plan.checks if check.name in names]
    renamed = [replace(check, name=f"{prefix}:{check.name}") for check in checks]
    return replace(plan, checks=renamed)


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
    checks = {f"{name}:{check}" for check in FAULTS[name].checks}
    assert {row.check for row in own if not row.passed} == checks
