"""How unlike two laws are."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tissue_laws import compared


@pytest.mark.parametrize(("share", "unlike"), [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5)])
def test_what_no_multiple_explains(share, unlike):
    own, other = np.zeros((2, 4, 1, 3), np.float32)
    own[:2, 0, 0], other[2:, 0, 0] = 0.003, 0.004
    second = np.sqrt(1 - share) * own / 0.003 + np.sqrt(share) * other / 0.004
    found = compared({"own": own, "second": second.astype(np.float32)})
    np.testing.assert_allclose(found["second"]["unlike"], unlike, atol=1e-6)
    np.testing.assert_allclose(found["own"]["max_mm"], 3, rtol=1e-6)
