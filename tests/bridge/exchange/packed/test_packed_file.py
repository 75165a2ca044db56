"""Packed files: as small as stated, as exact as stated, and nothing else is taken for one."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest

from bridge import DsnetError
from bridge.exchange.packed import open_packed, write_packed
from bridge.runs.digests import json_sha256

BOUND_M = 1e-5
FRAMES, VERTICES = 300, 7


@pytest.fixture(scope="module")
def offsets_m():
    """(300, 7, 3): more than two blocks."""
    phase = np.linspace(0, 20, FRAMES)[:, None, None] + np.arange(VERTICES * 3).reshape(-1, 3)
    return (0.03 * np.sin(phase)).astype(np.float32)


@pytest.fixture
def packed_path(tmp_path, offsets_m):
    path = tmp_path / "packed.npz"
    write(path, offsets_m)
    return path


def write(path, offsets_m, bound_m=BOUND_M):
    with write_packed(path, data="synthetic", kind="test") as writer:
        writer.add_bounded("offsets", offsets_m, "m", bound_m)
        writer.add("theta", np.arange(6.0).reshape(2, 3), "rad")


def forge(path, change):
    """Rewrite what a file says of itself, with the digest that belongs to it."""
    with np.load(path) as archive:
        members = {name: archive[name] for name in archive.files}
    about = json.loads(str(members["about"]))
    change(about["content"], members)
    about["sha256"] = json_sha256(about["content"])
    members["about"] = np.array(json.dumps(about))
    np.savez_compressed(path, **members)


def read(path):
    with open_packed(path) as packed:
        return {name: packed.array(name) for name in (*packed.bounded, *packed.exact)}


def test_round_trip(packed_path, offsets_m):
    with open_packed(packed_path) as packed:
        assert packed.origin == "synthetic"
        assert packed.facts["kind"] == "test"
        entry = packed.bounded["offsets"]
        apart = np.abs(packed.array("offsets").astype(float) - offsets_m).max()
        assert apart == entry.largest_error <= entry.bound == BOUND_M
        assert packed.exact == {"theta": "rad"}
        np.testing.assert_array_equal(packed.array("theta"), np.arange(6.0).reshape(2, 3))
    assert packed_path.stat().st_size < offsets_m.nbytes / 2


def test_the_same_arrays_give_the_same_bytes(packed_path, tmp_path, offsets_m):
    write(tmp_path / "again.npz", offsets_m)
    assert (tmp_path / "again.npz").read_bytes() == packed_path.read_bytes()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(tmp_path, offsets_m, value):
    damaged = offsets_m.copy()
    damaged[200, 3, 1] = value
    with pytest.raises(DsnetError, match="frames 128 to 255"):
        write(tmp_path / "new.npz", damaged)


@pytest.mark.parametrize("bound_m", [0.0, -1e-5, 1e-12])
def test_a_bound_that_cannot_be_kept_is_refused(tmp_path, offsets_m, bound_m):
    with pytest.raises(DsnetError, match="bound"):
        write(tmp_path / "new.npz", offsets_m, bound_m)


@pytest.mark.parametrize("kept", [0, 1, 100, -1, -30])
def test_a_truncated_file_is_one_line(packed_path, kept):
    packed_path.write_bytes(packed_path.read_bytes()[:kept])
    with pytest.raises(DsnetError, match="does not unpack"):
        read(packed_path)


def test_a_flipped_byte_is_refused_or_means_nothing(packed_path):
    """Some bytes of an archive, dates for one, say nothing about what it holds."""
    whole, refused = packed_path.read_bytes(), 0
    expected = read(packed_path)
    places = np.random.default_rng(0).integers(len(whole), size=150)
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 0x40
        packed_path.write_bytes(flipped)
        try:
            found = read(packed_path)
        except DsnetError:
            refused += 1
            continue
        assert found.keys() == expected.keys()
        for name, array in expected.items():
            np.testing.assert_array_equal(found[name], array)
    assert refused > 0.7 * len(places)


def _too_large(content, members):
    content["bounded"]["offsets"]["shape"][0] = 10**6
    content["bounded"]["offsets"]["differences"] = [1] * (10**6 // 128 + 1)


def _too_wide(content, members):
    content["bounded"]["offsets"]["shape"][1] = 10**12


def _without_blocks(content, members):
    content["bounded"]["offsets"]["differences"] = []


def _no_step(content, members):
    content["bounded"]["offsets"]["step"] = float("nan")


def _up_the_folders(content, members):
    content["bounded"]["../offsets"] = content["bounded"].pop("offsets")


def _other_data(content, members):
    content["data"] = "real"


def _other_version(content, members):
    content["format"] = "dsnet packed arrays, version 2"


def _large_block(content, members):
    members["offsets/00000"] = np.zeros((3, 10**7), np.uint8)


def _changed_block(content, members):
    members["offsets/00000"] = members["offsets/00000"] ^ 1


def _of_objects(content, members):
    content["exact"]["theta"] = None


@pytest.mark.parametrize(
    "change",
    [
        _too_large,
        _too_wide,
        _without_blocks,
        _no_step,
        _up_the_folders,
        _other_data,
        _other_version,
        _large_block,
        _changed_block,
        _of_objects,
    ],
)
def test_a_forged_file_is_one_line(packed_path, change):
    forge(packed_path, change)
    with pytest.raises(DsnetError, match="does not unpack") as caught:
        read(packed_path)
    assert "\n" not in str(caught.value)


def test_another_archive_is_one_line(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
        archive.writestr("offsets.npy", b"nothing")
    with pytest.raises(DsnetError, match="does not unpack"):
        read(tmp_path / "other.npz")
