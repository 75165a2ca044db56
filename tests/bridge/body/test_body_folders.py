"""Of a folder the file of a motion's gender and kind, whatever else lies there."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge import DsnetError
from bridge.body import load_body_model
from bridge.body.embedded import embedded_gender
from bridge.body.model_data import Kind
from tests.forged.bodies import REFUSED, fields_of, npz, person

_SMPLX_LAYOUT = {
    "smpl/SMPL_NEUTRAL.pkl": "smpl",
    "smpl/SMPL_FEMALE.pkl": "smpl",
    "smplh/SMPLH_FEMALE.pkl": "smplh",
    "smplx/SMPLX_FEMALE.npz": "smplx",
    "smplx/SMPLX_NEUTRAL.npz": "smplx",
    "smplx/SMPLX_NEUTRAL.pkl": "smplx",
    "mano/MANO_RIGHT.pkl": "MANO",
    "flame/FLAME_NEUTRAL.pkl": "FLAME",
}
_AMASS = {"smplh/female/model.npz": "smplh", "dmpls/female/model.npz": "DMPL"}
_OFFICIAL = {
    "smpl/models/basicmodel_f_lbs_10_207_0_v1.1.0.pkl": "smpl",
    "smpl/models/basicmodel_neutral_lbs_10_207_0_v1.1.0.pkl": "smpl",
    "__MACOSX/smpl/models/._basicmodel_f_lbs_10_207_0_v1.1.0.pkl": "zeros",
    ".DS_Store": "zeros",
}
_MANOS_DOWNLOAD = {
    "mano_v1_2/models/SMPLH_female.pkl": "smplh",
    "mano_v1_2/models/MANO_RIGHT.pkl": "MANO",
}
_ONE_KIND = {"SMPLX_FEMALE.npz": "smplx", "SMPLX_to_J14.pkl": "17 rows", "version.txt": "text"}
_NO_KIND_IN_NAMES = {"x/male/model.npz": "smplx", "h/male/model.pkl": "smplh"}


def laid_out(folder: Path, files: dict[str, str]) -> Path:
    for name, what in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        kind: Kind | None = what if what in ("smpl", "smplh", "smplx") else None
        path.write_bytes(npz(fields_of(person(kind))) if kind else REFUSED[what][1])
    return folder


@pytest.mark.parametrize(
    ("files", "gender", "kind", "expected"),
    [
        (_SMPLX_LAYOUT, "female", "smplx", "smplx/SMPLX_FEMALE.npz"),
        (_SMPLX_LAYOUT, "female", "smplh", "smplh/SMPLH_FEMALE.pkl"),
        (_SMPLX_LAYOUT, "female", None, "smpl/SMPL_FEMALE.pkl"),
        (_SMPLX_LAYOUT, "neutral", "smpl", "smpl/SMPL_NEUTRAL.pkl"),
        (_SMPLX_LAYOUT, "neutral", "smplx", "smplx/SMPLX_NEUTRAL.npz"),
        (_SMPLX_LAYOUT, "neutral", "smplh", "smpl/SMPL_NEUTRAL.pkl"),
        (_SMPLX_LAYOUT, "unknown", "smpl", "smpl/SMPL_NEUTRAL.pkl"),
        (_AMASS, "female", "smplx", "smplh/female/model.npz"),
        (_OFFICIAL, "female", "smpl", "smpl/models/basicmodel_f_lbs_10_207_0_v1.1.0.pkl"),
        (_ONE_KIND, "female", "smpl", "SMPLX_FEMALE.npz"),
        (_ONE_KIND, None, None, "SMPLX_FEMALE.npz"),
        (_NO_KIND_IN_NAMES, "male", "smplh", "h/male/model.pkl"),
        (_NO_KIND_IN_NAMES, "male", "smplx", "x/male/model.npz"),
        ({"smplh/SMPLH_female.pkl": "smplh"}, "female", "smplh", "smplh/SMPLH_female.pkl"),
        ({"model.npz": "smpl"}, "male", "smpl", "model.npz"),
        (_MANOS_DOWNLOAD, "female", "smplh", "mano_v1_2/models/SMPLH_female.pkl"),
    ],
)
def test_the_file_of_gender_and_kind_is_taken_and_told(
    tmp_path: Path, files: dict[str, str], gender: str, kind: str, expected: str
) -> None:
    body = load_body_model(laid_out(tmp_path, files), gender, kind)
    assert body.notes[0].startswith(f"{expected} of {tmp_path} is the body")
    assert body.kind == files[expected]


@pytest.mark.parametrize("files", [_SMPLX_LAYOUT, _ONE_KIND, _AMASS])
def test_a_gender_that_the_folder_lacks_is_refused(tmp_path: Path, files: dict[str, str]) -> None:
    with pytest.raises(DsnetError, match=r"no male body in it; expected one of .*(?i:female)"):
        load_body_model(laid_out(tmp_path, files), "male", "smpl")


def test_no_embedded_body_is_neutral() -> None:
    assert embedded_gender("male") == ("male", None)
    assert embedded_gender("unknown") == ("female", None)
    gender, line = embedded_gender("neutral")
    assert gender == "female"
    assert "--gender male" in (line or "")
