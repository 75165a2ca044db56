"""The rates of `dsnet plan` are as their tool writes them."""

from __future__ import annotations

from bridge.plan.rates import MEASURED, RATES
from tools.update_rates import RATES_FILE, rates_module


def test_no_rate_was_typed() -> None:
    assert rates_module(MEASURED, RATES) == RATES_FILE.read_text()
