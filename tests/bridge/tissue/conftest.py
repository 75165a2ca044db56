from __future__ import annotations

import pytest

from bridge.body import BodyModelData, load_body_model
from bridge.tissue.nodes import TissueNodes


@pytest.fixture(scope="session")
def body() -> BodyModelData:
    return load_body_model("embedded:female")


@pytest.fixture(scope="session")
def nodes(body: BodyModelData) -> TissueNodes:
    return TissueNodes.of(body, 80)
