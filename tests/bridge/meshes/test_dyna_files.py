"""Dyna's files written and read, whole and in windows; women and men are trained apart."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest

from bridge.errors import DsnetError
from bridge.meshes.dyna_files import DynaSequence, dyna_sequences, of_one_gender, write_dyna
from tests.forged.registrations import save_registrations


@pytest.fixture
def clip(body):
    drift = np.arange(20)[:, None, None] * np.array([0.01, 0.0, -0.02])
    return (body.v_template + drift).astype(np.float32)


@pytest.fixture
def file(tmp_path, body, clip):
    path = tmp_path / "dyna.h5"
    with write_dyna(path, body.faces) as add:
        add("50020_hips", clip)
        add("50004_one_leg_jump", clip[5:8])
    return path


def test_round_trip_keeps_every_value(file, body, clip):
    read = {sequence.name: sequence.read() for sequence in dyna_sequences([file])}
    assert list(read) == ["50004_one_leg_jump", "50020_hips"]
    np.testing.assert_array_equal(read["50020_hips"], clip)
    np.testing.assert_array_equal(dyna_sequences([file])[1].read(18, 99), clip[18:])
    np.testing.assert_array_equal(read["50004_one_leg_jump"], clip[5:8])
    assert read["50020_hips"].dtype == np.float32


def test_layout_on_disk_is_dynas(file, body, clip):
    with h5py.File(file) as raw:
        assert set(raw) == {"faces", "50020_hips", "50004_one_leg_jump"}
        stored = {name: np.asarray(raw[name]) for name in raw}
    np.testing.assert_array_equal(stored["50020_hips"][:, :, 7], clip[7])
    np.testing.assert_array_equal(stored["faces"], body.faces)


def test_iterating_holds_one_sequence(tmp_path, body, clip):
    path = tmp_path / "dyna.h5"
    with write_dyna(path, body.faces) as add:
        for motion in range(12):
            add(f"50004_m{motion}", clip)
    tracemalloc.start()
    for sequence in dyna_sequences([path]):
        sequence.read()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * clip.nbytes


def test_missing_file_folder_and_nothing(tmp_path):
    with pytest.raises(DsnetError, match="no such file"):
        dyna_sequences([tmp_path / "none.h5"])
    with pytest.raises(DsnetError, match="a folder"):
        dyna_sequences([tmp_path])
    with pytest.raises(DsnetError, match="--dyna"):
        dyna_sequences([])


@pytest.mark.parametrize("keep", [0, 100, 5000, 500_000])
def test_truncated_file(file, keep):
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(DsnetError, match="not readable as HDF5"):
        [sequence.read() for sequence in dyna_sequences([file])]


def test_damaged_directory(file):
    """HDF5's library reports a broken name table as RuntimeError, others otherwise."""
    whole = bytearray(file.read_bytes())
    for signature in (b"HEAP", b"TREE", b"SNOD"):
        damaged = whole.copy()
        damaged[whole.index(signature)] ^= 0xFF
        file.write_bytes(damaged)
        with pytest.raises(DsnetError, match="not readable as HDF5") as caught:
            dyna_sequences([file])
        assert "\n" not in str(caught.value)


def test_foreign_files(tmp_path, clip):
    text = tmp_path / "text.h5"
    text.write_text("not HDF5")
    with pytest.raises(DsnetError, match="not readable"):
        dyna_sequences([text])
    weights = tmp_path / "weights.h5"
    with h5py.File(weights, "w") as other:
        other["kernel"] = np.zeros((3, 3))
    with pytest.raises(DsnetError, match="no sequences"):
        dyna_sequences([weights])
    with pytest.raises(DsnetError, match="<subject>_<motion>"):
        dyna_sequences([save_registrations(tmp_path / "unnamed.h5", {"walk": clip})])


def test_sequence_names_must_be_unique(file, tmp_path):
    with pytest.raises(DsnetError, match="twice"):
        dyna_sequences([file, file])


WOMEN, MEN = ("50004", "50022"), ("50002", "50027")


def sequences(*subjects):
    return [DynaSequence(Path("dyna.h5"), f"{s}_hips", 3) for s in subjects]


@pytest.mark.parametrize(
    ("gender", "kept", "left_out"), [("female", WOMEN, "male"), ("male", MEN, "female")]
)
def test_of_both_files_the_bodys_gender_is_kept(gender, kept, left_out, capsys):
    found = of_one_gender(sequences(*WOMEN, *MEN, "90001"), gender)
    assert [one.subject for one in found] == [*kept, "90001"]
    said = capsys.readouterr().err
    assert said == f"dsnet: 2 of 5 sequences left out: {left_out} subjects, {gender} body model\n"


@pytest.mark.parametrize("gender", ["female", "neutral", "unknown"])
def test_one_gender_is_kept_whole_and_silently(gender, capsys):
    given = sequences(*WOMEN, "90001")
    assert of_one_gender(given, gender) == given
    assert capsys.readouterr().err == ""


def test_only_the_other_gender_is_refused():
    with pytest.raises(DsnetError, match=r"\['50002', '50027'\], who are male, with a female body"):
        of_one_gender(sequences(*MEN), "female")


@pytest.mark.parametrize("gender", ["neutral", "unknown"])
def test_both_genders_need_a_body_that_chooses(gender):
    with pytest.raises(DsnetError, match=f"women and men .* of gender {gender}; expected one"):
        of_one_gender(sequences(*WOMEN, *MEN), gender)
