"""The reference's descent: its gradient is that of SMPL's complex steps, and it descends."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import load_body_model
from dsnet.verify import draws
from dsnet.verify.reference import descent, smpl

BODY = "embedded:female"


@pytest.fixture(scope="module")
def given():
    """Two meshes, and bodies near them."""
    frames = draws.frames(0, load_body_model(BODY), 2)
    return {name: array.astype(float) for name, array in frames.items()}


def test_the_gradient_is_that_of_complex_steps_through_all_vertices(given):
    data, mesh = load_body_model(BODY), given["mesh"]
    bodies = {name: given[name] for name in ("betas", "pose", "trans")}
    distances, slopes = descent.MeshDistance(data, mesh).gradient({}, bodies)
    residual = smpl.posed_vertices(data, **bodies) - mesh
    np.testing.assert_allclose(distances, np.linalg.norm(residual.reshape(2, -1), axis=1))
    probe = residual / distances[:, None, None]
    expected = smpl.gradient(data, {**bodies, "offsets": np.zeros_like(mesh)}, probe)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, expected[name], atol=1e-10 * abs(expected[name]).max())


@pytest.mark.parametrize("with_shape", [False, True])
def test_it_comes_closer_with_more_steps(given, with_shape):
    inputs = {"mesh": given["mesh"]} if with_shape else given
    few, more = (descent.descent(BODY, steps=steps, **inputs) for steps in (1, 20))
    assert (more["descent/distances"] < few["descent/distances"]).all()
    assert ("descent/betas" in more) == with_shape
