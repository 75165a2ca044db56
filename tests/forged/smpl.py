"""SMPL model files of every variety that is distributed, forged from a free body."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bridge.body import BodyModelData
from tests.forged.python2_pickle import Ch, python2_pickle, sliced

Fields = dict[str, Any]


def smpl_fields(body: BodyModelData) -> Fields:
    """All fields of a licensed file, in its types, those that no reader needs included.

    `posedirs` are stored in float32, which halves the bytes and moves nothing by 1e-8 m.
    """
    parents = np.where(body.parents < 0, 2**32 - 1, body.parents)
    regressor = sp.csc_matrix(body.J_regressor)
    return {
        "J": body.joints,
        "J_regressor": regressor,
        "J_regressor_prior": regressor,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
        "f": body.faces.astype(np.uint32),
        "kintree_table": np.stack([parents, np.arange(24)]).astype(np.uint32),
        "posedirs": body.posedirs.astype(np.float32),
        "shapedirs": body.shapedirs,
        "v_template": body.v_template,
        "vert_sym_idxs": np.arange(len(body.v_template)),
        "weights": body.weights,
        "weights_prior": body.weights,
    }


def with_components(fields: Fields, count: int) -> Fields:
    """Shape components beyond the first ten."""
    more = np.full((6890, 3, count), 0.5, dtype=np.float32)
    more[:, :, :10] = fields["shapedirs"]
    return fields | {"shapedirs": more}


def as_chumpy(fields: Fields) -> Fields:
    """As version 1.0.0 stores it: shapes are a slice of more, the template may be a `Ch`."""
    shapes = fields["shapedirs"]
    more = np.concatenate([shapes, np.full((*shapes.shape[:2], 2), 9.0)], axis=2)
    return fields | {
        "shapedirs": sliced(Ch(more), more.shape, shapes.shape[2]),
        "v_template": Ch(fields["v_template"]),
    }


def npz(fields: Fields) -> bytes:
    """An archive; a sparse matrix in it becomes an object array, which is a pickle."""
    file = io.BytesIO()
    np.savez(file, **fields)
    return file.getvalue()


def _dense(fields: Fields) -> Fields:
    return fields | {"J_regressor": fields["J_regressor"].toarray()}


VARIETIES: dict[str, tuple[str, Callable[[Fields], bytes]]] = {
    "v1.0.0, protocol 0": (
        "basicModel_f_lbs_10_207_0_v1.0.0.pkl",
        lambda fields: python2_pickle(as_chumpy(fields), 0),
    ),
    "v1.0.0, protocol 2": (
        "basicModel_f_lbs_10_207_0_v1.0.0.pkl",
        lambda fields: python2_pickle(as_chumpy(fields), 2),
    ),
    "v1.1.0": (
        "basicmodel_f_lbs_10_207_0_v1.1.0.pkl",
        lambda fields: python2_pickle(with_components(fields, 300), 2),
    ),
    "v1.1.0 of a newer SciPy": (
        "basicmodel_f_lbs_10_207_0_v1.1.0.pkl",
        lambda fields: python2_pickle(fields, 2, "scipy.sparse._csc"),
    ),
    "saved again by Python 3": ("SMPL_FEMALE.pkl", pickle.dumps),
    "npz": ("SMPL_FEMALE.npz", lambda fields: npz(_dense(fields))),
    "npz, 300 components": ("SMPL_FEMALE.npz", lambda f: npz(with_components(_dense(f), 300))),
    "npz of a pickle": ("SMPL_FEMALE.npz", npz),
}


def forge_smpl(folder: Path, variety: str, body: BodyModelData) -> Path:
    """Write `body` as the variety's file into `folder`, under the name that it comes with."""
    name, encode = VARIETIES[variety]
    path = folder / name
    path.write_bytes(encode(smpl_fields(body)))
    return path
