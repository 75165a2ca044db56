"""Mesh files that declare too much, point elsewhere or hold what is no person."""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest

from bridge.body import load_body_model
from bridge.errors import DsnetError
from tests.forged.registrations import save_registrations
from torch_align_ae.corpus.dyna_files import DynaReader


@pytest.fixture(scope="module")
def body():
    return load_body_model("embedded:female")


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
        DynaReader([file])
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
        DynaReader([file])


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
        DynaReader([path])


def test_sequences_too_long_to_be_one_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("50004_hips", (6890, 3, 10**6), "f4", chunks=(6890, 3, 2000))
        for chunk in range(500):
            file["50004_hips"].id.write_direct_chunk((0, 0, 2000 * chunk), b"x")
    with pytest.raises(DsnetError, match="1000000 frames"):
        DynaReader([path])


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    for path in (tmp_path / "pipe.h5", "/dev/zero", tmp_path / ("x" * 5000)):
        with pytest.raises(DsnetError, match="no such file"):
            DynaReader([path])
