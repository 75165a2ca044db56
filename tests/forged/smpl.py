"""SMPL's own files, forged from a free body of its size."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import scipy.sparse as sp

from bridge.body import BodyModelData
from tests.forged.python2_pickle import Ch, sliced

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
