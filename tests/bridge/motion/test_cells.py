"""The four cells: takes are no kinds of their own, and an unknown cell is refused."""

from __future__ import annotations

import pytest

from bridge.errors import DsnetError
from bridge.motion import MotionSequence
from bridge.motion.cells import (
    CELLS,
    cell_label,
    cell_of,
    kind_of,
    take_suffix,
    trained_people_and_kinds,
)
from bridge.motion.sequences import Split


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
    ],
)
def test_every_test_sequence_has_its_cell(subject: str, motion: str, expected: str) -> None:
    people, kinds = trained_people_and_kinds(TRAINED)
    found = cell_of(sequence(subject, motion), people, kinds)
    assert found == expected
    assert cell_label(found) == CELLS[expected]


def test_people_and_kinds_are_those_of_training_alone() -> None:
    assert trained_people_and_kinds(TRAINED[:2]) == ({"50004"}, {"hips"})


def test_a_take_is_the_same_kind() -> None:
    assert kind_of("running_on_spot" + take_suffix(2)) == "running_on_spot"


def test_an_unknown_cell_is_one_line() -> None:
    with pytest.raises(DsnetError, match="cell 'old_person'; expected one of known_person") as told:
        cell_label("old_person")
    assert str(told.value).count("\n") == 0
