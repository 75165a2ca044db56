"""glTF as another reader finds it, skinned as the format says."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from bridge.body.skin import skin_png
from dsnet.exporters import glb
from dsnet.exporters.glb import ENOUGH_M, BlendShapes
from dsnet.prediction.moving_body import MovingBody
from tests.dsnet.exporters.conftest import FRAMES, moving_body

pygltflib = pytest.importorskip("pygltflib")
DTYPES = {5121: "u1", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@pytest.fixture(scope="module")
def path(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("glb") / "body.glb"
    glb.write(path, performed.moving)
    return path


class Played:
    """What a player does with a file: one mesh, one skin, one animation."""

    def __init__(self, path) -> None:
        self.gltf = pygltflib.GLTF2().load(str(path))
        self.blob = self.gltf.binary_blob()
        (self.mesh,), (self.skin,) = self.gltf.meshes, self.gltf.skins
        (self.primitive,), (self.animation,) = self.mesh.primitives, self.gltf.animations
        copies = self.gltf.meshes[0].extras["dsnet"].get("copies_of", [])
        points = self.gltf.accessors[self.primitive.attributes.POSITION].count
        self.vertex = np.array([*range(points - len(copies)), *copies])
        """The body's vertex that each of the file's is."""
        assert len(self.vertex) == points
        self.targets = [self.array(one["POSITION"]) for one in self.primitive.targets or []]

    def array(self, number: int) -> NDArray:
        accessor = self.gltf.accessors[number]
        view, width = self.gltf.bufferViews[accessor.bufferView], WIDTHS[accessor.type]
        dtype = np.dtype(DTYPES[accessor.componentType])
        assert view.byteOffset % 4 == 0
        assert view.byteLength == dtype.itemsize * width * accessor.count
        found = np.frombuffer(self.blob, dtype, width * accessor.count, view.byteOffset)
        found = found.reshape(-1, width)
        if accessor.min:
            np.testing.assert_array_equal(found.min(0), np.array(accessor.min, dtype))
            np.testing.assert_array_equal(found.max(0), np.array(accessor.max, dtype))
        return found

    def vertices_m(self, frame: int) -> NDArray:
        nodes = self.gltf.nodes
        turned = {n: [0, 0, 0, 1] for n in range(len(nodes))}
        moved = {n: node.translation for n, node in enumerate(nodes)}
        weights = np.zeros(len(self.targets))
        for channel in self.animation.channels:
            values = self.array(self.animation.samplers[channel.sampler].output)
            node, path = channel.target.node, channel.target.path
            if path == "weights":
                weights = values.reshape(-1, len(self.targets))[frame]
            else:
                {"rotation": turned, "translation": moved}[path][node] = values[frame]
        world, (root, body) = {}, self.gltf.scenes[0].nodes
        assert nodes[body].skin == 0
        left = [(root, np.eye(4))]
        while left:
            node, above = left.pop()
            own = np.eye(4)
            own[:3, :3] = Rotation.from_quat(turned[node]).as_matrix()
            own[:3, 3] = moved[node]
            world[node] = above @ own
            left += [(child, world[node]) for child in nodes[node].children or []]
        inverse = self.array(self.skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        bones = np.stack([world[node] for node in self.skin.joints]) @ inverse
        rest = self.array(self.primitive.attributes.POSITION).astype(float)
        rest = rest + sum(w * t for w, t in zip(weights, self.targets, strict=True))
        joints = self.array(self.primitive.attributes.JOINTS_0)
        shares = self.array(self.primitive.attributes.WEIGHTS_0)
        np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-6)
        return np.einsum("vk,vkij,vj->vi", shares, bones[joints], np.c_[rest, np.ones(len(rest))])[
            :, :3
        ]


def test_a_player_shows_the_body_within_the_error_that_the_file_states(performed, path):
    played = Played(path)
    stated_m = 1e-3 * played.gltf.asset.extras["dsnet"]["largest_error_mm"]
    assert 0 < stated_m < 2e-3
    for frame in (0, 20, FRAMES - 1):
        expected_m = performed.vertices_m[frame][played.vertex]
        off_m = np.linalg.norm(played.vertices_m(frame) - expected_m, axis=-1)
        assert off_m.max() <= stated_m + 2e-5
    assert np.abs(np.diff(performed.vertices_m, axis=0)).max() > 20 * stated_m


def test_rate_names_and_facts(performed, path):
    played = Played(path)
    assert played.gltf.asset.extras["dsnet"]["data"] == "synthetic"
    times_s = played.array(played.animation.samplers[0].input)[:, 0]
    np.testing.assert_allclose(times_s, np.arange(FRAMES) / 60, atol=1e-6)
    assert played.gltf.nodes[0].name == "pelvis"
    assert len(played.mesh.extras["targetNames"]) == len(played.targets)
    faces = played.array(played.primitive.indices).reshape(-1, 3)
    np.testing.assert_array_equal(played.vertex[faces], performed.moving.body.faces)
    turns = [c for c in played.animation.channels if c.target.path == "rotation"]
    for channel in turns:
        values = played.array(played.animation.samplers[channel.sampler].output)
        assert (np.einsum("tq,tq->t", values[1:], values[:-1]) > 0).all()


def test_trimesh_opens_it_and_finds_the_skin(performed, path):
    scene = trimesh.load_scene(path)
    (mesh,) = scene.geometry.values()
    played, body = Played(path), performed.moving.body
    assert mesh.vertices.shape == (len(played.vertex), 3)
    assert 1.5 < np.ptp(mesh.vertices[:, 1]) < 2.0
    places = body.texture.places[body.texture.corners]
    np.testing.assert_allclose(mesh.visual.uv[mesh.faces], places, atol=1e-6)
    shipped = Image.open(io.BytesIO(skin_png(body) or b"")).convert("RGB")
    shown = mesh.visual.material.baseColorTexture.convert("RGB")
    np.testing.assert_array_equal(np.asarray(shown), np.asarray(shipped))


def test_a_skin_changes_no_surface(performed, path, tmp_path):
    """All that belongs to copies on seams is that of the vertices that they are copies of."""
    moving = MovingBody(performed.moving.trained, performed.moving.motion)
    moving.plain = True
    glb.write(tmp_path / "plain.glb", moving)
    played, plain = Played(path), Played(tmp_path / "plain.glb")
    assert not plain.gltf.materials
    assert not plain.gltf.images
    assert plain.primitive.attributes.TEXCOORD_0 is None
    for name in ("POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0"):
        both = (one.array(getattr(one.primitive.attributes, name)) for one in (played, plain))
        found, expected = both
        np.testing.assert_array_equal(found, expected[played.vertex])
    for found, expected in zip(played.targets, plain.targets, strict=True):
        np.testing.assert_array_equal(found, expected[played.vertex])
    counts = {
        played.gltf.accessors[number].count
        for number in vars(played.primitive.attributes).values()
        if number is not None
    }
    assert counts == {len(played.vertex)}
    assert played.gltf.materials[played.primitive.material].name == "skin"


def test_shapes_are_all_that_a_short_motion_needs_and_weights_within_0_and_1(character):
    shapes = BlendShapes(moving_body(character, 12))
    products = shapes.directions @ shapes.directions.T
    np.testing.assert_allclose(products, np.eye(len(products)), atol=1e-5)
    assert shapes.error_m <= ENOUGH_M
    assert (shapes.weights.min(), shapes.weights.max()) == (0.0, pytest.approx(1.0))


def test_a_body_that_stands_still_has_no_shapes(character, tmp_path):
    moving = moving_body(character, 1)
    still = MovingBody(character, moving.motion, gain=0.0)
    glb.write(tmp_path / "still.glb", still)
    played = Played(tmp_path / "still.glb")
    assert played.targets == []
    (posed,) = still
    expected_m = posed.vertices_m[0][played.vertex]
    np.testing.assert_allclose(played.vertices_m(0), expected_m, atol=2e-6)
