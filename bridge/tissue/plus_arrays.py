"""Whether the arrays in a file are those of a `dsnet_plus`: what it indexes is there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.paper import N_BETAS

_MOST_FRAMES_AHEAD = 60


def check_plus_arrays(arrays: Mapping[str, NDArray], node_fields: Iterable[str]) -> None:
    """Refuse arrays that are missing, do not fit one another or point outside.

    Raises
    ------
    DsnetError
        That names the array.
    """
    nodes, vertices = (_length(arrays, f"nodes/{name}") for name in ("vertices", "owners"))
    people, edges = _length(arrays, "people_betas"), _length(arrays, "nodes/edges")
    expected: dict[str, tuple[int | None, ...]] = {
        "nodes/vertices": (nodes,),
        "nodes/owners": (vertices, None),
        "nodes/shares": arrays["nodes/owners"].shape,
        "nodes/areas_m2": (vertices,),
        "nodes/edges": (edges, 2),
        "nodes/pulls_m2": (edges,),
        **{f"log_{name}": (nodes, 1) for name in node_fields},
        "slopes": (3, 1),
        "stiffening_power": (1,),
        "residual": (people, nodes, 1),
        "taps": (None,),
        "people_betas": (people, N_BETAS),
        "constant_m": (None, None, 3),
        "by_pose_m": (None, None, 3),
        "look_ahead": (1,),
    }
    for name, shape in expected.items():
        _length(arrays, name)
        found = arrays[name].shape
        fits = len(found) == len(shape) and all(
            wanted in (None, size) for size, wanted in zip(found, shape, strict=True)
        )
        if not fits or not np.isfinite(arrays[name]).all():
            raise _refused(f"{name!r} of shape {found}", f"finite numbers of shape {shape}")
    bounds = {"nodes/vertices": vertices, "nodes/owners": nodes, "nodes/edges": nodes}
    for name, most in {**bounds, "look_ahead": _MOST_FRAMES_AHEAD}.items():
        array = arrays[name]
        if array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= most:
            raise _refused(f"{name!r} that point outside", f"whole numbers of 0 to {most - 1}")


def _length(arrays: Mapping[str, NDArray], name: str) -> int:
    if name not in arrays or not arrays[name].ndim:
        raise _refused(f"no {name!r}", "all of its arrays")
    return len(arrays[name])


def _refused(received: str, expected: str) -> DsnetError:
    remedy = "Train it again, or copy the file again."
    return DsnetError(f"a file of dsnet_plus with {received}", expected, remedy)
