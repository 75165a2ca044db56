"""The 70/30 splits: the paper's sizes, disjoint, seeded, clips kept whole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge import DsnetError
from bridge.motion import MotionSequence
from bridge.motion.sequences import Split
from bridge.motion.splits import (
    CELLS,
    cell_of,
    held_out_frames,
    kind_of,
    split_autoencoder_frames,
    split_frames,
    splits_of_names,
    take_suffix,
    trained_people_and_kinds,
)


def test_sizes_are_the_papers():
    split = split_frames(np.arange(21_502), seed=0)
    assert (len(split.train), len(split.validation)) == (15_051, 6_451)


@given(st.integers(2, 3000), st.integers(0, 5))
def test_frame_split_is_a_partition_of_floor_70_percent(count, seed):
    split = split_frames(np.arange(count), seed)
    assert len(split.train) == 7 * count // 10
    np.testing.assert_array_equal(
        np.sort(np.concatenate([split.train, split.validation])), np.arange(count)
    )
    np.testing.assert_array_equal(split_frames(np.arange(count), seed).train, split.train)
    other = split_frames(np.arange(count), seed + 1)
    assert count < 50 or not np.array_equal(other.train, split.train)


def test_sequences_stay_whole():
    starts = np.cumsum([0, 5, 8, 3, 9, 4])
    index = [
        MotionSequence(f"s_{k}", "s", str(k), int(start), length, 60.0)
        for k, (start, length) in enumerate(zip(starts, [5, 8, 3, 9, 4, 6], strict=True))
    ]
    split = split_autoencoder_frames(index, 0, by="sequence", include_held_out=True)
    sides = [{bool(np.isin(f, split.train)) for f in range(35)[s.frames]} for s in index]
    assert all(len(side) == 1 for side in sides)
    assert sum(True in side for side in sides) == 4
    np.testing.assert_array_equal(
        np.sort(np.concatenate([split.train, split.validation])), np.arange(35)
    )


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_frames_is_one_line(count):
    with pytest.raises(DsnetError, match="at least 2"):
        split_frames(np.arange(count), seed=0)
    with pytest.raises(DsnetError, match=r"at least 2.*frame-level"):
        split_autoencoder_frames(_corpus()[:count], 0, by="sequence", include_held_out=True)


def _corpus() -> list[MotionSequence]:
    splits = ("train", "validation", "train", "test", "train")
    return [
        MotionSequence(f"s_{k}", "s", str(k), 10 * k, 10, 60.0, split)
        for k, split in enumerate(splits)
    ]


@pytest.mark.parametrize("by", ["frame", "sequence"])
def test_held_out_sequences_do_not_reach_the_autoencoder(by):
    split = split_autoencoder_frames(_corpus(), 0, by=by, include_held_out=False)
    seen = np.concatenate([split.train, split.validation])
    np.testing.assert_array_equal(np.sort(seen), [*range(10), *range(20, 30), *range(40, 50)])
    np.testing.assert_array_equal(held_out_frames(_corpus()), [*range(10, 20), *range(30, 40)])


def test_the_papers_own_way_draws_from_all_frames():
    split = split_autoencoder_frames(_corpus(), 3, by="frame", include_held_out=True)
    expected = split_frames(np.arange(50), 3)
    np.testing.assert_array_equal(split.train, expected.train)
    np.testing.assert_array_equal(split.validation, expected.validation)


def test_named_sequences_are_held_out_and_else_the_last():
    names = ["a", "b", "c"]
    assert splits_of_names(names, ("b", "z")) == {"a": "train", "b": "validation", "c": "train"}
    assert splits_of_names(names, ("z",)) == {"a": "train", "b": "train", "c": "validation"}
    assert splits_of_names(["a"], ()) == {"a": "train"}


def sequence(subject: str, motion: str, split: Split = "test") -> MotionSequence:
    return MotionSequence(f"{subject}_{motion}", subject, motion, 0, 10, 60.0, split)


TRAINED = [
    sequence("50004", "one_leg_jump", "validation"),
    sequence("50004", "hips", "train"),
    sequence("50020", "one_leg_jump", "train"),
]


@pytest.mark.parametrize(
    ("subject", "motion", "expected"),
    [
        ("50004", "hips_take2", "known_person_known_motion"),
        ("50020", "hips", "known_person_known_motion"),
        ("50004", "one_leg_jump_take12", "known_person_known_motion"),
        ("50004", "kicking", "known_person_unseen_motion"),
        ("50004", "hips_taken", "known_person_unseen_motion"),
        ("99001", "hips", "new_person_known_motion"),
        ("99001", "hips_take2", "new_person_known_motion"),
        ("99001", "amass_hips", "new_person_unseen_motion"),
        # As MPI_mosh has them.
        ("50004", "hips2", "known_person_known_motion"),
        ("00096", "hips_3", "new_person_known_motion"),
        ("50004", "misc_hips", "known_person_unseen_motion"),
        ("50027", "misc_dancing_hiphop", "new_person_unseen_motion"),
    ],
)
def test_every_test_sequence_has_its_cell(subject: str, motion: str, expected: str) -> None:
    people, kinds = trained_people_and_kinds(TRAINED)
    found = cell_of(sequence(subject, motion), people, kinds)
    assert found == expected
    assert found in CELLS


@pytest.mark.parametrize(
    ("motion", "kind"),
    [
        ("running_on_spot" + take_suffix(2), "running_on_spot"),
        ("running_on_spot_bugfix", "running_on_spot"),
        ("simple_crouch2", "simple_crouch"),
        ("jumping_jacks_1", "jumping_jacks"),
        ("misc_7", "misc"),
        ("stretch_poses", "stretch_poses"),
        ("06", "06"),
        ("bvh_06", "bvh_06"),
        ("amass_misc_1", "amass_misc_1"),
    ],
)
def test_a_take_is_the_same_kind(motion: str, kind: str) -> None:
    assert kind_of(motion) == kind
