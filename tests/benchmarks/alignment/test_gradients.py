from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.alignment import gradients
from benchmarks.alignment.gradients import (
    GradientsConfig,
    gradient_ways,
    jacobian_ways,
    main,
)
from bridge.body import load_body_model
from torch_align_ae import SMPL

# PyTorch's own: its forward mode scripts some derivatives.
pytestmark = pytest.mark.filterwarnings("ignore:.torch.jit.script. is deprecated")


# The robust aligner's Jacobian leaves out blend shapes below 0.1 mm per radian.
@pytest.mark.parametrize(("make", "atol"), [(gradient_ways, 1e-4), (jacobian_ways, 3e-4)])
def test_all_ways_lead_to_the_same_derivatives(make, atol):
    first, *others = (way() for way in make(SMPL(load_body_model("embedded:female")), 1).values())
    for other in others:
        for one, same in zip(first, other, strict=True):
            np.testing.assert_allclose(same, one, atol=atol)


def test_the_file_says_what_each_way_costs(tmp_path, monkeypatch):
    monkeypatch.setattr(gradients, "_AT_ONCE", 1)
    main(GradientsConfig(tmp_path / "gradients.json", bodies=(1,), frames=1, rounds=1))
    found = json.loads((tmp_path / "gradients.json").read_text())
    assert found["threads: 1"]["gradient, 1 bodies"]["by hand"]["ratio"] == 1
    assert found["threads: 2"]["jacobian, 1 frames"]["torch.func.jacfwd"]["cpu_ms"] > 0
