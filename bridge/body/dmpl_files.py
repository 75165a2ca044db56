"""Read DMPL's directions, `dmpls/<gender>/model.npz`, as its owners distribute them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import DMPL_DIRECTIONS, N_VERTICES
from bridge.runs.untrusted import damage_refused, open_npz

_FIELD = "eigvec"
_MOST_FILE_BYTES = 1 << 29
_MOST_BYTES = 1 << 27  # 300 directions in float64 are 50 MB
_EXPECTED = (
    f"`{_FIELD}` ({N_VERTICES}, 3, {DMPL_DIRECTIONS} or more) of directions that are not parallel"
)
_REMEDY = "Download DMPL (dmpls/<gender>/model.npz) again from smpl.is.tue.mpg.de."


def load_dmpl_directions(path: str | Path) -> NDArray[np.float64]:
    """The first 8 directions (6890, 3, 8) in which a soft body moves.

    Raises
    ------
    DsnetError
        If the file is missing, damaged or not DMPL's.
    """
    path = Path(path)

    def refusal(error: Exception) -> DsnetError:
        detail = f"no {_FIELD!r}" if isinstance(error, KeyError) else str(error)[:200]
        return DsnetError(f"DMPL {path}: {detail}", _EXPECTED, _REMEDY)

    with damage_refused(refusal), open_npz(path, _MOST_FILE_BYTES) as archive:
        archive.check(_FIELD, _MOST_BYTES)
        found = archive.array(_FIELD)
    fits = found.shape[:2] == (N_VERTICES, 3) and found.ndim == 3 and found.dtype.kind in "iuf"
    if not fits or found.shape[2] < DMPL_DIRECTIONS:
        raise DsnetError(
            f"DMPL {path}: {_FIELD} of {found.dtype} in shape {found.shape}", _EXPECTED, _REMEDY
        )
    directions = found[..., :DMPL_DIRECTIONS].astype(np.float64)
    columns = directions.reshape(-1, DMPL_DIRECTIONS)
    if not np.isfinite(columns).all() or np.linalg.matrix_rank(columns) < DMPL_DIRECTIONS:
        raise DsnetError(
            f"DMPL {path}: directions that are parallel, or not numbers", _EXPECTED, _REMEDY
        )
    return directions
