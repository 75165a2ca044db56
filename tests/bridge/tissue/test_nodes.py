"""Nodes on the skin: what their surface reproduces, and their Laplacian."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.body import BodyModelData
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from bridge.tissue.nodes import TissueNodes


def at_nodes(nodes: TissueNodes, frames: int = 3, seed: int = 0) -> np.ndarray:
    shape = (frames, len(nodes), 3)
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def test_a_body_moved_as_a_whole_stays_one(nodes):
    moved = np.tile(np.array([0.01, -0.02, 0.03], np.float32), (2, len(nodes), 1))
    everywhere = nodes.spread(moved)
    assert everywhere.shape == (2, 6890, 3)
    np.testing.assert_allclose(everywhere, np.broadcast_to(moved[0, 0], (2, 6890, 3)), rtol=1e-5)
    np.testing.assert_allclose(nodes.shares.sum(1), 1.0, atol=1e-6)


def test_the_surface_goes_through_its_nodes(nodes):
    values = at_nodes(nodes)
    np.testing.assert_allclose(nodes.spread(values)[:, nodes.vertices], values, atol=1e-5)


def test_the_surface_follows_a_linear_field_the_better_the_more_nodes(body, nodes):
    """A skin's curvature keeps least bending from being exact."""
    template = np.asarray(body.v_template, np.float32)
    errors = []
    for each in (TissueNodes.of(body, 40), nodes, TissueNodes.of(body, 240)):
        missed = each.spread(template[None, each.vertices])[0] - template
        weight = each.areas_m2[:, None] / each.areas_m2.sum()
        errors.append(float(np.sqrt((weight * missed**2).sum())))
    spread = float(np.sqrt((weight * (template - template.mean(0)) ** 2).sum()))
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 0.06 * spread
    assert errors[2] < 0.035 * spread


def test_gathering_undoes_spreading(nodes):
    values = at_nodes(nodes)
    np.testing.assert_allclose(nodes.gather(nodes.spread(values)), values, atol=1e-4)


def test_gathering_comes_closest_over_the_skins_area(nodes):
    """What the nodes cannot carry is perpendicular to all that they can."""
    offsets = np.random.default_rng(1).normal(size=(1, 6890, 3)).astype(np.float32)
    left = offsets - nodes.spread(nodes.gather(offsets))
    other = nodes.spread(at_nodes(nodes, 1, seed=2))
    product = float((nodes.areas_m2[:, None] * left * other).sum(dtype=np.float64))
    lengths = [float((nodes.areas_m2[:, None] * x**2).sum()) for x in (left, other)]
    assert abs(product) < 1e-4 * np.sqrt(lengths[0] * lengths[1])


def test_laplacian_is_that_of_a_surface(nodes):
    laplacian = nodes.laplacian.toarray()
    assert laplacian.shape == (80, 80)
    scale = np.abs(laplacian).max()
    np.testing.assert_allclose(laplacian.sum(1), 0, atol=1e-5 * scale)
    # Detailed balance: m_i L_ij = m_j L_ji for the masses, which L's left null vector holds.
    values, vectors = np.linalg.eig(laplacian.T)
    masses = np.real(vectors[:, np.abs(values).argmin()])
    masses /= masses.sum()
    assert masses.min() > 0
    pulls = masses[:, None] * laplacian
    np.testing.assert_allclose(pulls, pulls.T, atol=1e-6 * np.abs(pulls).max())
    stiffness = np.linalg.eigvalsh((pulls + pulls.T) / 2)
    assert stiffness[0] > -1e-6 * stiffness[-1]
    assert stiffness[1] > 1e-3 * stiffness[-1]


def test_laplacian_measures_a_smooth_fields_energy(body, nodes):
    """u^T M L u of the nodes is the Dirichlet energy over the whole skin, for a smooth u."""
    template = np.asarray(body.v_template, np.float64)
    height = template[:, 1]
    whole = height @ cotangent_laplacian(template, body.faces) @ height
    # A node stands for the skin that its harmonic share covers: L's left null vector, as above.
    values, vectors = np.linalg.eig(nodes.laplacian.toarray().T)
    masses = np.real(vectors[:, np.abs(values).argmin()])
    masses *= vertex_areas_m2(template, body.faces).sum() / masses.sum()
    found = (masses * height[nodes.vertices]) @ (nodes.laplacian @ height[nodes.vertices])
    assert found == pytest.approx(whole, rel=0.3)


def test_arrays_bring_the_same_nodes_back(nodes):
    again = TissueNodes.from_arrays(nodes.arrays())
    assert set(nodes.arrays()) == {
        f"nodes/{name}"
        for name in ("vertices", "owners", "shares", "areas_m2", "edges", "pulls_m2")
    }
    values = at_nodes(nodes)
    np.testing.assert_array_equal(again.spread(values), nodes.spread(values))
    np.testing.assert_array_equal(again.laplacian.toarray(), nodes.laplacian.toarray())


def test_nodes_are_the_same_bits_each_time(body: BodyModelData, nodes):
    again = TissueNodes.of(body, 80)
    for name, array in nodes.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    assert len(np.unique(nodes.vertices)) == 80


def test_a_part_of_a_motion_is_spread_as_the_whole_is(nodes):
    """Long sequences are predicted in pieces."""
    values = at_nodes(nodes, frames=7)
    whole = nodes.spread(values)
    for part in (slice(0, 3), slice(3, 7)):
        np.testing.assert_array_equal(nodes.spread(values[part]), whole[part])
