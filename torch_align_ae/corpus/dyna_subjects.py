"""Whose meshes are in Dyna and D-FAUST: each gender is aligned and trained apart (Section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence

from bridge.errors import DsnetError
from bridge.runs.processes import notify
from torch_align_ae.corpus.dyna_files import DynaEntry

DYNA_SUBJECTS = {
    "female": ("50004", "50020", "50021", "50022", "50025"),
    "male": ("50002", "50007", "50009", "50026", "50027"),
}
_OTHER = {"female": "male", "male": "female"}


def of_one_gender(entries: Sequence[DynaEntry], gender: str) -> list[DynaEntry]:
    """The sequences that a body model of `gender` fits; subjects who are not Dyna's are kept.

    Sequences of the other gender are left out, and a line on stderr says how many, so that
    `--dyna dyna_female.h5 dyna_male.h5` serves either body model.

    Raises
    ------
    DsnetError
        If nothing remains, or if the body model's gender cannot choose between women and men.
    """
    strangers = set(DYNA_SUBJECTS.get(_OTHER.get(gender, ""), ()))
    kept = [entry for entry in entries if entry.subject not in strangers]
    subjects = {entry.subject for entry in entries}
    if not kept:
        raise DsnetError(
            f"subjects {sorted(subjects)}, who are {_OTHER[gender]}, with a {gender} body model",
            f"Dyna's {gender} subjects {', '.join(DYNA_SUBJECTS[gender])}",
            f"Pass the {_OTHER[gender]} body model, or the {gender} mesh file.",
        )
    if not strangers and all(subjects & set(known) for known in DYNA_SUBJECTS.values()):
        raise DsnetError(
            f"women and men ({', '.join(sorted(subjects))}) with a body model of gender {gender}",
            "one gender a run, as in the paper",
            "Pass SMPL's female or male model, or mesh files of one gender.",
        )
    if left_out := len(entries) - len(kept):
        why = f"{_OTHER[gender]} subjects, {gender} body model"
        notify(f"{left_out} of {len(entries)} sequences left out: {why}")
    return kept
