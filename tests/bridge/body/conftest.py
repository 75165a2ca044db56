from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from bridge.body import BodyModelData, load_body_model
from bridge.body.model_data import SMPL_PARENTS


@pytest.fixture(scope="session")
def female() -> BodyModelData:
    return load_body_model("embedded:female")


@pytest.fixture(scope="session")
def male() -> BodyModelData:
    return load_body_model("embedded:male")


@pytest.fixture(params=["female", "male"])
def body(request: pytest.FixtureRequest) -> BodyModelData:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def small_body() -> BodyModelData:
    """60 random vertices: every term of the model is there, at a hundredth of the cost."""
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(24, 0.1), 60)
    regressor = sp.csr_matrix(rng.dirichlet(np.ones(60), 24))
    return BodyModelData(
        name="small",
        source="synthetic",
        gender="neutral",
        v_template=rng.normal(size=(60, 3)),
        shapedirs=rng.normal(scale=0.1, size=(60, 3, 10)),
        posedirs=rng.normal(scale=0.02, size=(60, 3, 207)),
        J_regressor=regressor,
        weights=weights,
        faces=rng.integers(0, 60, (100, 3)),
        parents=np.array(SMPL_PARENTS),
    )
