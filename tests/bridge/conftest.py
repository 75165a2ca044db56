"""A woman whose offsets are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.runtime.controls import Controls, controlled_body
from tests.forged.markers import Known


@pytest.fixture(scope="session")
def known() -> Known:
    """A woman whose flesh is what the packaged model predicts of jumping jacks."""
    path = Path("sample:jumping_jacks")
    trained, motion = Controls().load(None, None, path)
    moving = controlled_body(trained, motion, Controls())
    offsets = np.concatenate([part.offsets_m for part in moving]).astype(np.float64)
    return Known(trained.body, moving.motion, offsets)
