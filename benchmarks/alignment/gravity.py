"""Whether results are of tissue that gravity loads: results files say so since there is any."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch_align_ae.corpus.motions.plan import GRAVITY_M_S2

RECORDED = {"gravity_m_s2": GRAVITY_M_S2}
"""What a results file holds of it."""


def banner(results: Mapping[str, Any]) -> str:
    """What stands above the table of results that record no gravity; nothing above others."""
    if RECORDED.keys() <= results.keys():
        return ""
    day = results["provenance"]["finished_utc"][:10]
    return f"**Before gravity:** measured on {day}, when no tissue was loaded by it.\n\n"
