"""What a body's shape says of its softness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bridge.tissue.shape import SHAPE_FEATURES, distance_to_bones_m, shape_features


def test_the_template_has_no_features(body, nodes):
    found = shape_features(body, np.zeros(10), nodes.vertices)
    assert found.shape == (80, len(SHAPE_FEATURES))
    np.testing.assert_array_equal(found, 0.0)


def test_a_body_grown_all_over_is_deeper_and_larger_but_as_stout(body, nodes):
    """One shape direction is made the template itself, so that beta 0.1 scales by 1.1."""
    grown = replace(body, shapedirs=np.repeat(np.asarray(body.v_template)[:, :, None], 10, axis=2))
    betas = np.array([0.1] + [0.0] * 9)
    depth, girth, mass = shape_features(grown, betas, nodes.vertices).T
    np.testing.assert_allclose(depth[depth > 0], np.log(1.1), rtol=1e-3)
    np.testing.assert_allclose(girth, 2 * np.log(1.1), rtol=1e-4)
    np.testing.assert_allclose(mass, 0.0, atol=1e-5)


def test_distance_is_that_to_the_bone_or_its_nearer_end():
    joints, parents = np.array([[0.0, 0, 0], [0, 2, 0], [5, 2, 0]]), np.array([-1, 0, 1])
    points = np.array([[0.3, 1, 0], [0, -2, 0], [5, 2, 0.7], [2, 2.5, 0]])
    np.testing.assert_allclose(distance_to_bones_m(points, joints, parents), [0.3, 2, 0.7, 0.5])
