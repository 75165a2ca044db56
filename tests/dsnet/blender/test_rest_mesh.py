"""The body of a mesh is the one that it was made of, in whatever order, unit and axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.errors import DsnetError
from bridge.motion import Motion
from dsnet.blender.flesh import SceneFlesh, flesh_of_mesh
from dsnet.blender.rest_mesh import mesh_body
from dsnet.prediction.load_model import load_model
from tests.dsnet.blender.scenes import UP, scene_armature, scene_mesh

BODY = load_body_model("embedded:female")
SHUFFLED = np.random.default_rng(1).permutation(BODY.vertex_count)


@pytest.mark.parametrize("gender", ["female", "male"])
def test_an_embedded_body_is_known_with_its_shape(walk: Motion, gender: str) -> None:
    body = load_body_model(f"embedded:{gender}")
    made = mesh_body(scene_mesh(body, walk.betas), scene_armature(walk, body), {})
    assert made.body.name == body.name
    np.testing.assert_allclose(made.betas, walk.betas, atol=1e-6)
    np.testing.assert_allclose(made.to_world, UP, atol=1e-9)


@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_another_body_is_made_of_its_mesh(walk: Motion, unit: float) -> None:
    mesh = scene_mesh(BODY, walk.betas, SHUFFLED, unit)
    made = mesh_body(mesh, scene_armature(walk, unit=unit), {})
    assert made.body.name == "Body"
    np.testing.assert_allclose(made.to_world, unit * UP, atol=1e-7)
    expected = shaped_vertices(BODY, walk.betas[None])[0][SHUFFLED]
    shift = made.body.v_template[0] - expected[0]
    np.testing.assert_allclose(made.body.v_template - shift, expected, atol=1e-6)
    joints = shaped_joints(BODY, walk.betas[None])[0]
    np.testing.assert_allclose(made.body.joints[:22] - shift, joints[:22], atol=1e-6)
    weights = made.body.body_weights
    np.testing.assert_allclose(weights, BODY.body_weights[SHUFFLED], atol=1e-6)


@pytest.mark.slow
def test_its_flesh_moves_as_that_of_the_body(walk: Motion, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    armature = scene_armature(walk)
    made = mesh_body(scene_mesh(BODY, walk.betas, SHUFFLED), armature, {})
    motion = armature.motion({})
    offsets_m = np.concatenate([*flesh_of_mesh(made, motion, "female").offsets()])
    own = SceneFlesh(load_model("female"), replace(motion, betas=walk.betas, embedded_betas=True))
    expected_m = np.concatenate([*own.offsets()])[:, SHUFFLED]
    left = np.square(offsets_m - expected_m).sum() / np.square(expected_m).sum()
    assert left < 0.01  # a shape that is the template's, and not in betas, is fitted


def test_a_mesh_without_smpls_joints_is_refused(walk: Motion) -> None:
    armature = scene_armature(walk)
    bones = tuple(name.replace("collar", "feather") for name in armature.bones)
    with pytest.raises(DsnetError, match="no left_collar, right_collar"):
        mesh_body(scene_mesh(BODY, walk.betas), replace(armature, bones=bones), {})


def test_a_mesh_without_weights_is_refused(walk: Motion) -> None:
    mesh = scene_mesh(BODY, walk.betas, SHUFFLED)
    with pytest.raises(DsnetError, match="6890 vertices follow no bone"):
        mesh_body(replace(mesh, weights=0 * mesh.weights), scene_armature(walk), {})
