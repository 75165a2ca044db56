"""docs/verification.md shows the committed results, and they are the kind one may commit."""

from __future__ import annotations

from tests.forged.faults import FAULTS
from tools.update_verification import PAGE, load_parity, with_outcome


def test_the_outcome_is_up_to_date():
    page = PAGE.read_text()
    assert with_outcome(page) == page


def test_every_committed_row_holds():
    parity = load_parity()
    assert parity["passed"]
    assert all(row["passed"] for row in parity["rows"])


def test_every_fault_is_described_with_its_diagnosis():
    lines = PAGE.read_text().splitlines()
    for name, fault in FAULTS.items():
        (line,) = [line for line in lines if line.startswith(f"| `{name}` |")]
        assert fault.named in line
