"""Pickles that would run something, or exhaust the machine, are refused before they do."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge import DsnetError
from bridge.body import BodyModelData, load_body_model
from tests.forged.python2_pickle import Ch, python2_pickle
from tests.forged.smpl import npz, smpl_fields

_REST = b"}" + b"".join(
    b"S'%s'\nI0\ns" % name.encode()
    for name in ("weights", "f", "shapedirs", "posedirs", "J_regressor", "kintree_table")
)
"""The other fields of a model."""


class Intruder:
    """Creates a folder when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, int]]:
        return os.mkdir, (str(self.trace), 0o700)


@pytest.mark.parametrize("nested", [lambda intruder: intruder, Ch], ids=["bare", "in a Ch"])
@pytest.mark.parametrize("suffix", [".pkl", ".npz"])
def test_malicious_pickle_is_refused_and_not_run(
    female: BodyModelData, tmp_path: Path, suffix: str, nested: Callable[[Any], Any]
) -> None:
    trace, path = tmp_path / "trace", tmp_path / f"model{suffix}"
    hostile = smpl_fields(female) | {"J_regressor": nested(Intruder(trace))}
    path.write_bytes(npz(hostile) if suffix == ".npz" else python2_pickle(hostile))
    with pytest.raises(DsnetError, match=r"cannot be read safely .*it asks to run ") as caught:
        load_body_model(path)
    assert "\n" not in str(caught.value)
    assert not trace.exists()


@pytest.mark.parametrize(
    ("payload", "complaint"),
    [
        (b"cbuiltins\neval\n(S'1'\ntR.", "it asks"),
        (b"cnumpy\nload\n(S'x'\ntR.", "it asks"),
        (b"cnumpy.core.multiarray\nfromfile\n(S'x'\ntR.", "it asks"),
        (b"ccopy_reg\n_reconstructor\n(cnumpy\nndarray\nc__builtin__\nobject\nNtR.", "it asks"),
        (b"c_codecs\nencode\n(S'x'\nS'rot13'\ntR.", "it asks"),
        (b"cscipy.sparse.csc\nos\n.", "it asks"),
        (b"cnumpy\nndarray\n((L1000000000000000L\nttR.", "read safely"),
        (b"(" * 5000, "read safely"),
        (_REST + b"S'v_template'\ncchumpy.ch\nCh\n)\x81p0\n}S'a'\ng0\nsS'idxs'\nI0\nsbs.",
         "read safely"),
        (_REST + b"S'v_template'\ncchumpy.ch\nCh\n)\x81s.", "read safely"),
    ],
    ids=["eval", "load", "fromfile", "class", "codec", "module", "petabytes", "nested", "loop",
         "stateless"],
)  # fmt: skip
def test_other_gadgets_are_refused(tmp_path: Path, payload: bytes, complaint: str) -> None:
    (tmp_path / "model.pkl").write_bytes(payload)
    with pytest.raises(DsnetError, match=complaint):
        load_body_model(tmp_path / "model.pkl")


def _beyond_columns(fields: dict[str, Any]) -> dict[str, Any]:
    matrix = fields["J_regressor"].copy()
    matrix.indices[0] = 10**6
    return fields | {"J_regressor": matrix}


def _beyond_elements(fields: dict[str, Any]) -> dict[str, Any]:
    select = Ch(np.zeros(3))
    select.__dict__.update(a=Ch(np.zeros(3)), idxs=np.array([3]))
    return fields | {"v_template": select}


@pytest.mark.parametrize("edit", [_beyond_columns, _beyond_elements])
def test_indices_out_of_range_are_refused(
    female: BodyModelData, tmp_path: Path, edit: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    (tmp_path / "model.pkl").write_bytes(python2_pickle(edit(smpl_fields(female))))
    with pytest.raises(DsnetError, match="cannot be read safely"):
        load_body_model(tmp_path / "model.pkl")
