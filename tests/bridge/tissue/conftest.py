from __future__ import annotations

import pytest

from bridge.body import BodyModelData
from bridge.tissue.nodes import TissueNodes


@pytest.fixture(scope="session")
def nodes(body: BodyModelData) -> TissueNodes:
    return TissueNodes.of(body, 80)
