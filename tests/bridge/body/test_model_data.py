"""Body model data: validation, and round trips through SMPL's own file formats."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model

ARRAYS = ("v_template", "shapedirs", "posedirs", "weights", "faces", "parents")


@pytest.mark.parametrize("suffix", ["npz", "pkl"])
def test_save_then_load_gives_the_same_model(
    body: BodyModelData, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"model.{suffix}"
    getattr(body, f"save_smpl_{suffix}")(path)
    loaded = load_body_model(path)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(loaded, name), getattr(body, name))
    np.testing.assert_array_equal(loaded.J_regressor.toarray(), body.J_regressor.toarray())
    assert (loaded.source, loaded.gender) == ("synthetic", body.gender)
    assert list(tmp_path.iterdir()) == [path], "no temporary file is left"


def test_files_have_the_fields_of_smpl(female: BodyModelData, tmp_path: Path) -> None:
    female.save_smpl_npz(tmp_path / "model.npz")
    female.save_smpl_pkl(tmp_path / "model.pkl")
    npz = np.load(tmp_path / "model.npz")
    pkl = pickle.loads((tmp_path / "model.pkl").read_bytes())
    for fields in (npz, pkl):
        assert fields["f"].dtype == np.uint32
        assert fields["kintree_table"].shape == (2, 24)
        assert fields["kintree_table"][0, 0] == 2**32 - 1
        np.testing.assert_allclose(fields["J"], female.joints)
        assert (str(fields["bs_style"]), str(fields["bs_type"])) == ("lbs", "lrotmin")
    assert npz["J_regressor"].shape == (24, 6890)
    assert isinstance(pkl["J_regressor"], sp.csc_matrix)


def test_unwritable_path_leaves_nothing_behind(small_body: BodyModelData, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "absent" / "model.npz", tmp_path / "folder"):
        with pytest.raises(DsnetError, match="cannot write"):
            small_body.save_smpl_npz(path)
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


def test_failed_write_keeps_the_old_file(
    small_body: BodyModelData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "model.npz"
    path.write_text("old")

    def fail_halfway(file: Any, **_: Any) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail_halfway)
    with pytest.raises(DsnetError, match="No space left"):
        small_body.save_smpl_npz(path)
    assert [p.name for p in tmp_path.iterdir()] == ["model.npz"]
    assert path.read_text() == "old"
