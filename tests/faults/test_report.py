"""Two reports of one run are the same bytes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.faults.conftest import Base
from tests.faults.stages import check_as_undisturbed, copy_before, make

pytestmark = pytest.mark.faults
FAULT = "report"


def test_a_second_report_is_the_first(base: Base, tmp_path: Path, tally: Counter[str]) -> None:
    copy_before("report", base.runs, tmp_path)
    assert make("report", tmp_path).status == 0
    check_as_undisturbed("report", base.runs, tmp_path)
    tally["the same bytes"] += 1
