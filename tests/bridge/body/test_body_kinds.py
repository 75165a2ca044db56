"""Every kind of body file that people have: loaded right, or refused by its true reason."""

from __future__ import annotations

import io
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from bridge import DsnetError
from bridge.body import load_body_model, load_paper_body, pose_vertices
from bridge.body.model_data import Texture
from bridge.body.posing import Smpl, fitted_betas, full_pose
from tests.forged.bodies import LOADS, REFUSED, fields_of, forged, npz, person, zipped


@pytest.mark.parametrize("variety", LOADS)
def test_loads_as_the_body_that_it_is(tmp_path: Path, variety: str) -> None:
    name, content, body = forged(variety)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(content)
    found = load_body_model(path)
    assert (found.kind, found.gender, found.notes) == (body.kind, "female", ())
    np.testing.assert_array_equal(found.faces, body.faces)
    rng = np.random.default_rng(1)
    betas = rng.normal(size=(2, body.shapedirs.shape[2]))
    pose, trans = rng.normal(0, 0.4, (2, len(body.parents), 3)), rng.normal(size=(2, 3))
    expected = pose_vertices(body, betas, pose, trans)
    tolerance_m = 1e-6 if LOADS[variety][1].get("dtype") else 1e-9
    np.testing.assert_allclose(pose_vertices(found, betas, pose, trans), expected, atol=tolerance_m)
    np.testing.assert_allclose(found.expressiondirs, body.expressiondirs, atol=1e-9)


@pytest.mark.parametrize("what", REFUSED)
def test_is_refused_by_its_true_reason(tmp_path: Path, what: str) -> None:
    name, content, reason = REFUSED[what]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DsnetError, match=reason) as caught:
        load_body_model(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("columns", [11, 16, 26, 110, 300])
def test_of_other_columns_of_smplx_only_the_first_ten_are_shapes(
    tmp_path: Path, columns: int
) -> None:
    body = person("smplx", columns)
    (tmp_path / "SMPLX_MALE.npz").write_bytes(npz(fields_of(body)))
    found = load_body_model(tmp_path / "SMPLX_MALE.npz")
    assert found.shapedirs.shape[2] == 10
    assert found.expressiondirs.shape[2] == columns - 10
    assert f"{columns} columns" in found.notes[0]


@pytest.mark.parametrize(("kind", "shapes", "expressions"), [("smplh", 3, 0), ("smplx", 7, 4)])
@pytest.mark.parametrize("suffix", ["npz", "pkl"])
def test_what_is_written_comes_back(
    tmp_path: Path, kind: str, shapes: int, expressions: int, suffix: str
) -> None:
    body = person(kind, shapes, expressions)  # pyright: ignore[reportArgumentType]
    getattr(body, f"save_smpl_{suffix}")(tmp_path / f"a.{suffix}")
    found = load_body_model(tmp_path / f"a.{suffix}")
    for name in ("shapedirs", "expressiondirs", "posedirs", "hands_mean", "parents"):
        np.testing.assert_array_equal(getattr(found, name), getattr(body, name))


@pytest.mark.parametrize("kind", ["smplh", "smplx"])
def test_a_pose_of_22_joints_leaves_hands_and_face_at_rest(kind: str) -> None:
    body = person(kind)  # pyright: ignore[reportArgumentType]
    rng = np.random.default_rng(2)
    pose, trans = rng.normal(0, 0.5, (2, 24, 3)), np.zeros((2, 3))
    full = np.zeros((2, len(body.parents), 3))
    full[:, :22] = pose[:, :22]
    expected = pose_vertices(body, np.zeros((2, 10)), full, trans)
    for given in (pose, pose[:, :22]):  # SMPL's 22 and 23 are whole hands, and here a finger's
        found = pose_vertices(body, np.zeros((2, 10)), given, trans)
        np.testing.assert_array_equal(found, expected)
    fast = Smpl(body, dtype=np.float64).person(np.zeros(10)).pose(full, trans)
    np.testing.assert_allclose(fast, expected, atol=1e-6)


@pytest.mark.parametrize("count", [30, 33])
def test_hands_and_face_go_where_they_are(count: int) -> None:
    rng = np.random.default_rng(3)
    pose, others = rng.normal(size=(4, 22, 3)), rng.normal(size=(4, count, 3))
    on_x, on_h = (full_pose(pose, others, joints) for joints in (55, 52))
    face = others[:, :3] if count == 33 else np.zeros((4, 3, 3))
    np.testing.assert_array_equal(on_x, np.concatenate([pose, face, others[:, -30:]], axis=1))
    np.testing.assert_array_equal(on_h, np.concatenate([pose, others[:, -30:]], axis=1))


def test_betas_that_a_body_has_no_shapes_for_are_told() -> None:
    few, many = person(shapes=10), person(shapes=16)
    betas = np.arange(1.0, 17)
    assert fitted_betas(many, betas)[1] is None
    kept, note = fitted_betas(few, betas)
    np.testing.assert_array_equal(kept, betas[:10])
    assert note == "6 of 16 betas are left out: smpl has 10 shapes"
    kept, note = fitted_betas(many, betas[:11])
    assert len(kept) == 10
    assert note == "the last of 11 betas is left out: BEDLAM's and AGORA's is a kid's"
    assert fitted_betas(few, np.zeros(300)) == (pytest.approx(np.zeros(10)), None)


def test_other_bodies_are_not_the_papers(tmp_path: Path) -> None:
    (tmp_path / "SMPLH_MALE.npz").write_bytes(npz(fields_of(person("smplh"))))
    with pytest.raises(DsnetError, match="smplh of 162 vertices; expected SMPL's 24 joints"):
        load_paper_body(tmp_path / "SMPLH_MALE.npz")
    with pytest.raises(DsnetError, match="a folder; expected a model file"):
        load_paper_body(tmp_path)
    assert load_paper_body("embedded:male").shapedirs.shape == (6890, 3, 10)


def test_what_arrays_amount_to_is_checked_before_they_are_read(tmp_path: Path) -> None:
    file = io.BytesIO()
    header = {"descr": "|i1", "fortran_order": False, "shape": (1 << 26, 1)}
    np.lib.format.write_array_header_1_0(file, header)
    names = ("v_template", "weights", "shapedirs")
    (tmp_path / "a.npz").write_bytes(zipped({f"{name}.npy": file.getvalue() for name in names}))
    with pytest.raises(DsnetError, match="201326592 numbers"):
        load_body_model(tmp_path / "a.npz")


@pytest.mark.parametrize("suffix", ["npz", "pkl"])
def test_a_texture_is_kept(tmp_path: Path, suffix: str) -> None:
    body, rng = person("smplx"), np.random.default_rng(0)
    texture = Texture(rng.random((70, 2)), rng.integers(0, 70, body.faces.shape))
    body, path = replace(body, texture=texture), tmp_path / f"SMPLX_FEMALE.{suffix}"
    (body.save_smpl_npz if suffix == "npz" else body.save_smpl_pkl)(path)
    found = load_body_model(path).texture
    assert found is not None
    np.testing.assert_array_equal(found.places, texture.places)
    np.testing.assert_array_equal(found.corners, texture.corners)


@pytest.mark.parametrize(
    "damaged",
    [
        {"vt": np.full((70, 2), np.nan)},
        {"vt": np.zeros((70, 3))},
        {"ft": np.zeros((5, 3), int)},
        {"ft": np.array([[1], [2, 3]], object)},
        {"ft": np.array("none")},
        {"ft": np.full(person("smplx").faces.shape, 70)},
    ],
)
def test_a_texture_that_does_not_fit_is_left_out(
    tmp_path: Path, damaged: dict[str, np.ndarray]
) -> None:
    body = person("smplx")
    body.save_smpl_npz(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as stored:
        right = {"vt": np.zeros((70, 2)), "ft": np.zeros(body.faces.shape, int)}
        np.savez(tmp_path / "a.npz", **{**stored, **right, **damaged})
    assert load_body_model(tmp_path / "a.npz").texture is None


def test_tensors_of_types_that_numpy_lacks_are_left_out(tmp_path: Path) -> None:
    body = person()
    stored = {name: np.ascontiguousarray(values) for name, values in fields_of(body).items()}
    content = save(stored | {"one": np.zeros(3, np.int16), "two": np.zeros(3, np.uint8)})
    end = 8 + int.from_bytes(content[:8], "little")
    header = content[8:end].replace(b'"I16"', b'"BF16"').replace(b'"U8"', b'"F8_E4M3"')
    content = struct.pack("<Q", len(header)) + header + content[end:]
    (tmp_path / "SMPL_FEMALE.safetensors").write_bytes(content)
    found = load_body_model(tmp_path / "SMPL_FEMALE.safetensors")
    np.testing.assert_array_equal(found.v_template, body.v_template)


def test_a_header_longer_than_a_tensors_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.safetensors").write_bytes(struct.pack("<Q", 1 << 40) + b'{"a": 1}')
    with pytest.raises(DsnetError, match=r"cannot be read safely .*header too large"):
        load_body_model(tmp_path / "a.safetensors")
