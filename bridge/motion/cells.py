"""The four cells of test motions (Figure 9): known or new person, known or unseen kind."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

from bridge.errors import DsnetError
from bridge.motion.sequences import MotionSequence

CELLS = {
    "known_person_known_motion": "known person, known motion",
    "known_person_unseen_motion": "known person, unseen motion",
    "new_person_known_motion": "new person, known motion",
    "new_person_unseen_motion": "new person, unseen motion",
}
"""Label of each cell, from the easiest to the hardest."""

_TAKE = re.compile(r"_take\d+$")


def take_suffix(take: int) -> str:
    """What the name of a motion ends with when the same person does it again."""
    return f"_take{take}"


def kind_of(motion: str) -> str:
    """The kind of a motion: its name without the number of the take."""
    return _TAKE.sub("", motion)


def trained_people_and_kinds(sequences: Iterable[MotionSequence]) -> tuple[set[str], set[str]]:
    """Subjects and kinds of motion of the sequences that training sees."""
    trained = [sequence for sequence in sequences if sequence.split == "train"]
    return {s.subject for s in trained}, {kind_of(s.motion) for s in trained}


def cell_of(
    sequence: MotionSequence, known_people: Collection[str], known_kinds: Collection[str]
) -> str:
    """The cell of a test sequence, given whom and which kinds training has seen."""
    person = "known" if sequence.subject in known_people else "new"
    motion = "known" if kind_of(sequence.motion) in known_kinds else "unseen"
    return f"{person}_person_{motion}_motion"


def cell_label(name: str) -> str:
    """The label of a cell.

    Raises
    ------
    DsnetError
        If there is no such cell.
    """
    if name not in CELLS:
        raise DsnetError(f"cell {name!r}", f"one of {', '.join(CELLS)}", "Check its name.")
    return CELLS[name]
