"""Women and men are trained apart, whichever files are given."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.errors import DsnetError
from torch_align_ae.corpus.dyna_files import DynaEntry
from torch_align_ae.corpus.dyna_layout import of_one_gender

WOMEN, MEN = ("50004", "50022"), ("50002", "50027")


def entries(*subjects):
    return [DynaEntry(f"{s}_hips", s, "hips", 3, Path("dyna.h5")) for s in subjects]


@pytest.mark.parametrize(
    ("gender", "kept", "left_out"), [("female", WOMEN, "male"), ("male", MEN, "female")]
)
def test_of_both_files_the_bodys_gender_is_kept(gender, kept, left_out, capsys):
    found = of_one_gender(entries(*WOMEN, *MEN, "90001"), gender)
    assert [entry.subject for entry in found] == [*kept, "90001"]
    said = capsys.readouterr().err
    assert said == f"dsnet: 2 of 5 sequences left out: {left_out} subjects, {gender} body model\n"


@pytest.mark.parametrize("gender", ["female", "neutral", "unknown"])
def test_one_gender_is_kept_whole_and_silently(gender, capsys):
    given = entries(*WOMEN, "90001")
    assert of_one_gender(given, gender) == given
    assert capsys.readouterr().err == ""


def test_only_the_other_gender_is_refused():
    with pytest.raises(DsnetError, match=r"\['50002', '50027'\], who are male, with a female body"):
        of_one_gender(entries(*MEN), "female")


@pytest.mark.parametrize("gender", ["neutral", "unknown"])
def test_both_genders_need_a_body_that_chooses(gender):
    with pytest.raises(DsnetError, match=f"women and men .* of gender {gender}; expected one"):
        of_one_gender(entries(*WOMEN, *MEN), gender)
