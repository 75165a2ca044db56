"""Dyna's and D-FAUST's files in every form, and those that declare too much or hold no person."""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.meshes.dyna_files import dyna_sequences
from tests.forged.registrations import save_registrations


@pytest.fixture(scope="module")
def clip(body):
    drift = np.arange(20)[:, None, None] * np.array([0.01, 0.0, -0.02])
    return (body.v_template + drift).astype(np.float32)


@pytest.mark.parametrize(
    ("dtype", "layout"),
    [
        ("f4", {}),
        ("f8", {}),
        ("f8", {"chunks": True}),
        ("f4", {"chunks": (6890, 3, 1)}),
        ("f4", {"chunks": (689, 3, 20), "compression": "gzip", "shuffle": True}),
        ("f8", {"chunks": (6890, 3, 20), "compression": "gzip"}),
        ("f4", {"chunks": True, "fletcher32": True, "maxshape": (6890, 3, None)}),
    ],
)
def test_any_chunks_and_float_type_are_read(tmp_path, body, clip, dtype, layout):
    path = tmp_path / "registrations_f.hdf5"
    save_registrations(path, {"50004_hips": clip}, body.faces, dtype, **layout)
    (sequence,) = dyna_sequences([path])
    np.testing.assert_array_equal(sequence.read(3, 8), clip[3:8])
    np.testing.assert_array_equal(sequence.read(), clip)


def test_keys_are_found_not_assumed(tmp_path, clip):
    names = ["50004_running_on_spot_bugfix", "50020_personal_move", "50025_hips"]
    sequences = dict.fromkeys(names, np.asarray(clip[:2]))
    path = save_registrations(tmp_path / "dyna_female.h5", sequences)
    found = [(one.subject, one.motion) for one in dyna_sequences([path])]
    assert found == [tuple(name.split("_", 1)) for name in names]


@pytest.mark.parametrize("of_file", [True, False])
def test_meshes_of_another_rate_are_refused(tmp_path, clip, of_file):
    path = save_registrations(tmp_path / "dyna_female.h5", {"50004_hips": clip})
    with h5py.File(path, "a") as file:
        owner = file if of_file else file["50004_hips"]
        owner.attrs["fps"], owner.attrs["framerate"] = 60, "unknown"
    assert len(dyna_sequences([path])) == 1
    with h5py.File(path, "a") as file:
        owner = file if of_file else file["50004_hips"]
        owner.attrs["fps"] = np.array([30.0])
    with pytest.raises(DsnetError, match="50004_hips with fps 30; expected 60"):
        dyna_sequences([path])


def _with(frames, place, value):
    frames = frames.copy()
    frames[place] = value
    return frames


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f[:0], "zero frames"),
        (lambda f: f[:, :-1], "6889"),
        (lambda f: np.zeros((20, 10475, 3)), "10475"),
        (lambda f: f[..., :2], r"\(6890, 2, 20\)"),
        (lambda f: f * 1000, "seems to be in millimetres: divide it by 1000"),
        (lambda f: f * 100, "seems to be in centimetres: divide it by 100"),
        (lambda f: f / 0.0254, "seems to be in inches: divide it by 39.37"),
        (lambda f: f * 10, "Convert it to metres"),
        (lambda f: f * 0, "Convert it to metres"),
        (lambda f: f[..., [0, 2, 1]], "z up, or it lies"),
        (lambda f: (f * [0.3, 1, 1])[..., [1, 0, 2]], "x up, or it lies"),
        (lambda f: _with(f, (4, 17, 1), np.nan), "50004_a has NaN or infinite vertices in frame 4"),
        (lambda f: _with(f, 4, 1000 * f[4]), "50004_a in frame 4 .* divide it by 1000"),
        (lambda f: _with(f, (4, 17, 1), 3e30), "50004_a in frame 4 measures"),
    ],
)
def test_bad_sequences_are_named(tmp_path, clip, change, message):
    path = save_registrations(tmp_path / "bad.h5", {"50004_a": change(clip)})
    with pytest.raises(DsnetError, match=message) as caught:
        [sequence.read() for sequence in dyna_sequences([path])]
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_whole_numbers_are_no_metres(tmp_path, clip):
    path = save_registrations(tmp_path / "mm.h5", {"50004_a": clip * 1000}, dtype="i4")
    with pytest.raises(DsnetError, match=r"of int32; expected .* of float32 or float64"):
        dyna_sequences([path])


@pytest.mark.parametrize("turn", [0.0, 0.7, np.pi / 2, 2.5])
def test_upright_people_pass_whichever_way_they_face(tmp_path, clip, turn):
    """Also crouching to half of the height, with the arms spread."""
    facing = Rotation.from_euler("y", turn).as_matrix()
    crouching = clip[:2] @ np.diag([1.0, 0.55, 1.0])
    sequences = {"50004_stand": clip[:2] @ facing, "50004_crouch": crouching @ facing}
    path = save_registrations(tmp_path / "a.h5", sequences)
    assert len(dyna_sequences([path])) == 2


@pytest.mark.parametrize("chunks", [None, (6890, 3, 16)])
def test_frames_that_the_file_does_not_hold_are_not_believed(tmp_path, clip, chunks):
    path = save_registrations(tmp_path / "a.h5", {"50004_hips": clip})
    with h5py.File(path, "a") as file:
        many = file.create_dataset("50020_hips", (6890, 3, 10**9), "f4", chunks=chunks)
        if chunks:
            many[:, :, :16] = np.moveaxis(clip[:16], 0, -1)
    with pytest.raises(DsnetError, match="50020_hips declares 1000000000 frames") as caught:
        dyna_sequences([path])
    assert "\n" not in str(caught.value)


@pytest.fixture
def file(tmp_path, body):
    return save_registrations(tmp_path / "a.h5", {"50004_hips": body.v_template[None]}, body.faces)


def _elsewhere(file):
    place = [("/dev/zero", 0, h5py.h5f.UNLIMITED)]
    file.create_dataset("50020_a", (6890, 3, 2), "f4", external=place)


def _virtual(file):
    layout = h5py.VirtualLayout((6890, 3, 2), "f4")
    layout[:, :, 0] = h5py.VirtualSource("/dev/zero", "x", (6890, 3))
    file.create_virtual_dataset("50020_a", layout)


def _huge_chunk(file):
    file.create_dataset("50020_a", (6890, 3, 10**5), "f8", chunks=(6890, 3, 10**4))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (_elsewhere, "50020_a, whose data lie elsewhere"),
        (_virtual, "50020_a, whose data lie elsewhere"),
        (_huge_chunk, "50020_a in chunks of 1653600000 bytes"),
        (lambda f: f.__setitem__("50020_a", h5py.ExternalLink("/dev/zero", "/a")), "a link"),
        (lambda f: f.__setitem__("50020_a", h5py.SoftLink("/50004_hips")), "a link"),
        (lambda f: f.create_group("a\nb"), r"an item named 'a\\nb'"),
        (lambda f: f.create_group("\x1b[31m"), "an item named"),
        (lambda f: f.create_group("<script>"), "an item named"),
        (lambda f: f.create_group("x" * 5000), "an item named"),
    ],
)
def test_what_a_file_declares_is_checked_first(file, change, complaint):
    with h5py.File(file, "a") as opened:
        change(opened)
    with pytest.raises(DsnetError, match=complaint) as caught:
        dyna_sequences([file])
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "faces",
    [
        np.zeros((13776, 3), complex),
        np.full((13776, 3), b"x"),
        np.zeros((5, 3), int),
        np.full((13776, 3), np.nan),
        np.full((13776, 3), 6890),
        np.full((13776, 3), 0.5),
        None,
    ],
    ids=["complex", "text", "few", "nan", "outside", "fractional", "declared"],
)
def test_faces_that_are_none_are_refused(file, faces):
    with h5py.File(file, "a") as opened:
        del opened["faces"]
        if faces is None:
            opened.create_dataset("faces", (10**10, 3), "i8")
        else:
            opened["faces"] = faces
    with pytest.raises(DsnetError, match="faces that"):
        dyna_sequences([file])


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda v: v * [-1, 1, 1], "inside out.*mirrored"),
        (lambda v: v + np.array([1e6, 0, 0]), "is 1e.06 m off; expected a person within 100 m"),
    ],
)
def test_meshes_of_nobody_are_refused(tmp_path, body, change, complaint):
    frames = change(body.v_template)[None]
    path = save_registrations(tmp_path / "a.h5", {"50004_hips": frames}, body.faces)
    with pytest.raises(DsnetError, match=complaint):
        dyna_sequences([path])


def test_sequences_too_long_to_be_one_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("50004_hips", (6890, 3, 10**6), "f4", chunks=(6890, 3, 2000))
        for chunk in range(500):
            file["50004_hips"].id.write_direct_chunk((0, 0, 2000 * chunk), b"x")
    with pytest.raises(DsnetError, match="1000000 frames"):
        dyna_sequences([path])


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    for path in (tmp_path / "pipe.h5", "/dev/zero", tmp_path / ("x" * 5000)):
        with pytest.raises(DsnetError, match="no such file"):
            dyna_sequences([path])
