"""glTF, GLB, VRM and VRMA of one walk are the walk of its BVH; what is odd is told or refused."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import HowRead
from bridge.motion.readers import files_below, stated_gender
from bridge.motion.readers.gltf_files import GltfFile
from bridge.motion.readers.nodes import rate_of
from tests.forged.motion_kinds import MOST_DEG, MOST_M, apart
from tests.forged.scenes import VRM, glb, gltf
from tests.forged.walks import FRAMES, MIXAMO, bvh


@pytest.fixture
def reference(tmp_path: Path) -> Motion:
    path = tmp_path / "reference.bvh"
    path.write_text(bvh())
    return load_motion(path)


def written(tmp_path: Path, said: dict[str, Any], binary: bytes, name: str = "walk.glb") -> Path:
    path = tmp_path / name
    path.write_bytes(glb(said, binary))
    return path


def is_alike(motion: Motion, reference: Motion) -> bool:
    turn_deg, place_m = apart(motion, reference)
    return turn_deg < 0.01 * MOST_DEG and place_m < 0.01 * MOST_M


@pytest.mark.parametrize("kind", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_all_interpolations_are_exact_at_keys(tmp_path: Path, reference: Motion, kind: str) -> None:
    assert is_alike(load_motion(written(tmp_path, *gltf(kind=kind, default="moved"))), reference)


@pytest.mark.parametrize("where", ["data", "beside"])
def test_a_text_and_its_numbers(tmp_path: Path, reference: Motion, where: str) -> None:
    said, binary = gltf()
    coded = f"data:application/octet-stream;base64,{base64.b64encode(binary).decode()}"
    said["buffers"][0]["uri"] = coded if where == "data" else "walk%20all.bin"
    (tmp_path / "walk all.bin").write_bytes(binary)
    path = tmp_path / "walk.gltf"
    path.write_text(json.dumps(said))
    assert is_alike(load_motion(path), reference)


@pytest.mark.parametrize("version", [0, 1])
def test_bones_of_vrm_are_those_of_its_extension(
    tmp_path: Path, reference: Motion, version: int
) -> None:
    """Other nodes may be called as they like."""
    bones = [{"bone": name, "node": n} for n, name in enumerate(VRM[:22])]
    extensions: dict[str, Any] = {"VRM": {"humanoid": {"humanBones": bones}}}
    if version:
        by_name = {bone["bone"]: {"node": bone["node"]} for bone in bones}
        extensions = {"VRMC_vrm": {"humanoid": {"humanBones": by_name}}}
    names = [*MIXAMO[1:], MIXAMO[0]]
    path = written(tmp_path, *gltf(names, {}, extensions=extensions), name="walk.vrm")
    assert is_alike(load_motion(path), reference)


def test_of_several_animations_the_longest_is_read_and_told(
    tmp_path: Path, reference: Motion
) -> None:
    motion = load_motion(written(tmp_path, *gltf(animations={"idle": 9, "walk": FRAMES, "x": 2})))
    assert is_alike(motion, reference)
    assert "'walk', the longest animation (not idle, x), is sampled at 60 frames" in motion.notes[0]


def test_of_two_people_the_first_is_read_and_told(tmp_path: Path, reference: Motion) -> None:
    said, binary = gltf(skin=False)
    nodes = said["nodes"]
    second = [
        {**node, "name": f"B_{node['name']}", "children": [24 + n for n in node["children"]]}
        for node in nodes
    ]
    prop = {"name": "sword"}
    said["nodes"] = [*nodes, *second, prop]
    motion = load_motion(written(tmp_path, said, binary))
    assert is_alike(motion, reference)
    assert "holds 2 people: the first is read, not that of B_Hips" in motion.notes[0]


def test_bones_of_several_roots_are_one_person(tmp_path: Path, reference: Motion) -> None:
    """Below a node that is no joint, as game rigs have limbs."""
    said, binary = gltf()
    skin = said["skins"][0]
    inverse = said["accessors"][skin["inverseBindMatrices"]]
    inverse["count"], skin["joints"] = 23, [*range(1, 24)]
    said["bufferViews"][inverse["bufferView"]]["byteOffset"] += 64
    assert is_alike(load_motion(written(tmp_path, said, binary)), reference)


def test_a_bind_pose_in_another_unit_and_world_is_one(tmp_path: Path, reference: Motion) -> None:
    """Only its shape counts: a skin may be bound in centimetres, and lie."""
    said, binary = gltf()
    view = said["bufferViews"][said["accessors"][0]["bufferView"]]
    begin, end = view["byteOffset"], view["byteOffset"] + view["byteLength"]
    inverse = np.frombuffer(binary[begin:end], "<f4").reshape(24, 4, 4).swapaxes(1, 2)
    world = np.diag([100.0, 100.0, 100.0, 1.0]) @ np.eye(4)[[0, 2, 1, 3]] @ np.diag([1, 1, -1, 1])
    other = (inverse @ np.linalg.inv(world)).swapaxes(1, 2).astype("<f4").tobytes()
    path = written(tmp_path, said, binary[:begin] + other + binary[end:])
    assert is_alike(load_motion(path), reference)


def test_the_user_says_the_vertical_and_the_joints(tmp_path: Path, reference: Motion) -> None:
    path = written(tmp_path, *gltf([f"bone{n}" for n in range(24)]))
    with pytest.raises(DsnetError, match="has no pelvis"):
        load_motion(path)
    names = {name: f"bone{n}" for n, name in enumerate(load_names())}
    assert is_alike(load_motion(path, how=HowRead(joint_map=names)), reference)
    lying = load_motion(path, how=HowRead("z", names))
    assert not is_alike(lying, reference)


def load_names() -> tuple[str, ...]:
    from bridge.motion.skeletons import OWN_NAMES

    return OWN_NAMES


def test_numbers_are_sparse_and_normalised(tmp_path: Path) -> None:
    said = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 8}],
        "bufferViews": [{"buffer": 0, "byteLength": 4}, {"buffer": 0, "byteOffset": 4,
                                                          "byteLength": 4}],
        "accessors": [
            {"bufferView": 0, "componentType": 5120, "normalized": True, "count": 4,
             "type": "SCALAR"},
            {"componentType": 5121, "count": 3, "type": "SCALAR", "sparse": {
                "count": 2, "indices": {"bufferView": 1, "componentType": 5121},
                "values": {"bufferView": 1, "byteOffset": 2}}},
        ],
    }  # fmt: skip
    path = written(tmp_path, said, bytes([127, 0, 129, 128, 0, 2, 7, 9]))
    file = GltfFile.opened(path)
    np.testing.assert_allclose(file.array(0)[:, 0], [1, 0, -1, -1])
    np.testing.assert_array_equal(file.array(1)[:, 0], [7, 0, 9])


Change = Callable[[dict[str, Any]], object]
DAMAGE: dict[str, Change] = {
    "node 1 below two": lambda said: said["nodes"][5]["children"].append(1),
    "below themselves": lambda said: said["nodes"][23]["children"].append(0),
    "not in its folder": lambda said: said["buffers"][0].update(uri="../walk.bin"),
    "without its file": lambda said: said["buffers"][0].update(uri="gone.bin"),
    "compressed by EXT_meshopt_compression": lambda said: said["bufferViews"][3].update(
        extensions={"EXT_meshopt_compression": {}}
    ),
    "do not follow one another": lambda said: said["accessors"][1].update(
        said["accessors"][1], bufferView=2
    ),
    "89 values at 90 keys": lambda said: said["accessors"][2].update(count=89),
    "does not load .strides": lambda said: said["accessors"][2].update(count=1 << 40),
    "no glTF 2": lambda said: said["asset"].update(version="1.0"),
    "moves no joint": lambda said: said["animations"][0].update(
        channels=[{"sampler": 0, "target": {"node": 24, "path": "rotation"}}]
    ),
    "has no skeleton": lambda said: said.update(nodes=[{"mesh": 0}] * 24, skins=[]),
    "not all finite": lambda said: said["nodes"][0].update(scale=[1e999, 1, 1]),
    "does not load": lambda said: said["animations"][0].update(samplers={}),
}


@pytest.mark.parametrize("complaint", DAMAGE)
def test_what_is_damaged_is_one_line(tmp_path: Path, complaint: str) -> None:
    said, binary = gltf()
    DAMAGE[complaint](said)
    with pytest.raises(DsnetError, match=complaint) as caught:
        load_motion(written(tmp_path, said, binary))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"glTF", b"{}", b"[" * 99999, b"glTF" + b"\xff" * 16])
def test_what_is_no_gltf_is_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "walk.glb"
    path.write_bytes(content)
    with pytest.raises(DsnetError, match="does not load"):
        load_motion(path)


def test_models_in_a_folder_are_no_motions(tmp_path: Path) -> None:
    model = written(tmp_path, *gltf(animations={"still": 0}), name="model.glb")
    walk = written(tmp_path, *gltf())
    assert files_below(tmp_path) == [model, walk]
    assert [stated_gender(path) for path in (model, walk)] == [None, "unknown"]


def test_a_rate_is_that_of_keys_that_lie_one_a_frame() -> None:
    frames = np.arange(200)
    assert rate_of((frames / 30).astype(np.float32)) == 30
    assert rate_of(frames / 30 * 1.001) == pytest.approx(29.97, abs=1e-3)
    thinned = frames[np.random.default_rng(0).random(200) < 0.5] / 60
    assert rate_of(thinned, 24.0) == 24
    assert rate_of(np.array([0.0, 1.0, 2.0])) == 60
    assert rate_of(np.zeros(1)) == 60
