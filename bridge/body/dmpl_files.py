"""Read DMPL's directions, in which a soft body moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body.containers import MOST_FILE_BYTES
from bridge.body.safe_pickle import MOST_BYTES
from bridge.errors import DsnetError
from bridge.paper import DMPL_DIRECTIONS, N_VERTICES
from bridge.runs.untrusted import damage_refused, open_npz

_DMPL_REMEDY = "Download DMPL (dmpls/<gender>/model.npz) again from smpl.is.tue.mpg.de."


def load_dmpl_directions(path: str | Path) -> NDArray[np.float64]:
    """The first 8 directions (6890, 3, 8) in which a soft body moves, of DMPL's
    `dmpls/<gender>/model.npz`."""

    def refusal(error: Exception | str) -> DsnetError:
        detail = "no 'eigvec'" if isinstance(error, KeyError) else str(error)[:200]
        shape = f"({N_VERTICES}, 3, {DMPL_DIRECTIONS} or more)"
        expected = f"`eigvec` {shape} of directions that are not parallel"
        return DsnetError(f"DMPL {path}: {detail}", expected, _DMPL_REMEDY)

    with damage_refused(refusal), open_npz(path, MOST_FILE_BYTES) as archive:
        archive.check("eigvec", MOST_BYTES)
        found = archive.array("eigvec")
    fits = found.shape[:2] == (N_VERTICES, 3) and found.ndim == 3 and found.dtype.kind in "iuf"
    if not fits or found.shape[2] < DMPL_DIRECTIONS:
        raise refusal(f"eigvec of {found.dtype} in shape {found.shape}")
    directions = found[..., :DMPL_DIRECTIONS].astype(np.float64)
    columns = directions.reshape(-1, DMPL_DIRECTIONS)
    if not np.isfinite(columns).all() or np.linalg.matrix_rank(columns) < DMPL_DIRECTIONS:
        raise refusal("directions that are parallel, or not numbers")
    return directions
