"""Who of several people is read, and frames in which a tracker saw nobody: filled in, and told."""

from __future__ import annotations

import pickle
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import HowRead
from tests.forged.walks import FRAMES, by_frames, joints_m, of_camera, person, smpl, walk, y_up

PLACES_M = walk()[1]


def read(tmp_path: Path, stored: Any, person: int | None = None) -> Motion:
    """From a pickle, or of a dictionary of arrays an `.npz`."""
    path = tmp_path / "a.npz"
    if isinstance(stored, bytes):
        path = tmp_path / "a.pkl"
        path.write_bytes(stored)
    else:
        np.savez(path, **stored)
    return load_motion(path, 60.0, how=HowRead(person=person))


@pytest.mark.parametrize("as_list", [False, True])
def test_frames_that_were_never_seen_take_their_time(tmp_path: Path, as_list: bool) -> None:
    seen = np.setdiff1d(np.arange(FRAMES), [3, 4, 20, 41, 42, 43])
    stored = by_frames(seen)
    stored[0]["frame_ids"] = (seen + 100).tolist() if as_list else seen + 100
    motion = read(tmp_path, pickle.dumps(stored))
    assert len(motion.theta) == FRAMES
    np.testing.assert_allclose(motion.trans_m, PLACES_M, atol=2e-3)
    assert "has no frames 103 to 104, 120, 141 to 143: they are interpolated" in motion.notes[-1]


def test_every_other_frame_is_half_of_the_time(tmp_path: Path) -> None:
    motion = read(tmp_path, pickle.dumps(by_frames(np.arange(0, FRAMES, 2))))
    assert len(motion.theta) == FRAMES - 1
    np.testing.assert_allclose(motion.trans_m, PLACES_M[:-1], atol=5e-3)
    assert "and 39 more" in motion.notes[-1]


@pytest.mark.parametrize("jump_m", [0.0, 5.0])
def test_a_long_gap_or_a_cut_in_one_ends_the_motion(tmp_path: Path, jump_m: float) -> None:
    numbers = np.r_[:50, 85:FRAMES] if not jump_m else np.r_[:50, 53:FRAMES]
    stored = by_frames(numbers)
    stored[0]["trans"] = stored[0]["trans"] + jump_m * (numbers > 50)[:, None] * [1.0, 0.0, 0.0]
    motion = read(tmp_path, pickle.dumps(stored))
    np.testing.assert_allclose(motion.trans_m, PLACES_M[:50], atol=1e-6)
    assert motion.cuts == ()
    assert "frames 0 to 49 alone, the longest piece between long gaps" in motion.notes[-1]


def test_a_cut_beside_gaps_stays_where_it_is(tmp_path: Path) -> None:
    numbers = np.setdiff1d(np.arange(FRAMES), [10, 60])
    stored = by_frames(numbers)
    stored[0]["trans"] = stored[0]["trans"] + 5.0 * (numbers >= 30)[:, None] * [1.0, 0.0, 0.0]
    motion = read(tmp_path, pickle.dumps(stored))
    assert (len(motion.theta), motion.cuts) == (FRAMES, (30,))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [(np.zeros(FRAMES, int), "number no frames"), (np.full(FRAMES, "a.jpg"), "number no frames")],
)
def test_numbers_that_are_none_are_told(tmp_path: Path, numbers: np.ndarray, said: str) -> None:
    motion = read(tmp_path, smpl(frame_ids=numbers))
    assert len(motion.theta) == FRAMES
    assert any(said in note for note in motion.notes)


def test_frames_in_any_order_are_put_in_order(tmp_path: Path) -> None:
    order = np.random.default_rng(0).permutation(FRAMES)
    stored = {"frame_ids": order, "poses": y_up()[order], "trans": PLACES_M[order]}
    np.testing.assert_allclose(read(tmp_path, stored).trans_m, PLACES_M, atol=1e-9)


def test_frames_beyond_all_measure_are_refused(tmp_path: Path) -> None:
    stored = by_frames(np.arange(4))
    stored[0]["frame_ids"] = np.array([0, 1, 2, 10**8])
    with pytest.raises(DsnetError, match="numbered 0 to 100000000"):
        read(tmp_path, pickle.dumps(stored))


def test_frames_that_a_mask_leaves_out_are_not_read(tmp_path: Path) -> None:
    seen = np.ones(FRAMES, bool)
    seen[[0, 1, 30, FRAMES - 1]] = False
    trans_m = np.where(seen[:, None], PLACES_M, 900.0)
    motion = read(tmp_path, {"poses": y_up(), "trans": trans_m, "is_valid": seen})
    np.testing.assert_allclose(motion.trans_m, PLACES_M[2:-1], atol=2e-3)
    assert any("nobody in 3 frames at its ends" in note for note in motion.notes)
    assert any("no frames 30: they are interpolated" in note for note in motion.notes)
    with pytest.raises(DsnetError, match="nobody was seen"):
        read(tmp_path, {"poses": y_up(), "is_valid": np.zeros(FRAMES, bool)})


def test_any_of_several_people_can_be_read(tmp_path: Path) -> None:
    beside = PLACES_M + np.array([1.0, 0.0, 0.0])
    nested = {"fps": 60.0, "a": person(), "b": {"c": [person(trans=beside)]}}
    for stored in (pickle.dumps(nested), zlib.compress(pickle.dumps(nested)), of_camera(0)):
        first, second = (read(tmp_path, stored, number) for number in (1, 2))
        np.testing.assert_allclose(second.trans_m - first.trans_m, beside - PLACES_M, atol=1e-9)
        assert any("2 people: person 2, of 90 frames" in note for note in second.notes)
        with pytest.raises(DsnetError, match="2 people, and not person 3"):
            read(tmp_path, stored, 3)


def test_who_is_seen_longest_is_read(tmp_path: Path) -> None:
    stored = of_camera(0)
    stored["track_mask"][0, 40:] = False
    assert any("person 2, of 90 frames" in note for note in read(tmp_path, stored).notes)


def test_a_person_whom_a_file_has_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DsnetError, match="holds one person, and not person 2"):
        read(tmp_path, smpl(), 2)
    np.save(tmp_path / "a.npy", joints_m())
    with pytest.raises(DsnetError, match="holds one person, and not person 2"):
        load_motion(tmp_path / "a.npy", how=HowRead(person=2))
    for name in ("a.bvh", "a.fbx", "a.glb"):
        with pytest.raises(DsnetError, match=r"--person 2 with .*, of whose skeletons the first"):
            load_motion(tmp_path / name, how=HowRead(person=2))


def test_dictionaries_in_one_another_are_followed_once(tmp_path: Path) -> None:
    """Lists of lists that are the same would be looked at a million million times."""
    inner: list[Any] = [{"none": 1}] * 1000
    for _ in range(4):
        inner = [inner] * 1000
    with pytest.raises(DsnetError, match="without poses"):
        read(tmp_path, pickle.dumps({"a": inner}))


def test_what_compression_hides_is_bounded(tmp_path: Path) -> None:
    whole = zlib.compress(pickle.dumps({0: person()}))
    assert len(read(tmp_path, whole).theta) == FRAMES
    with pytest.raises(DsnetError, match="end early"):
        read(tmp_path, whole[:-20])
    with pytest.raises(DsnetError, match="compressed by bz2 or lzma"):
        read(tmp_path, b"BZh91AY")
