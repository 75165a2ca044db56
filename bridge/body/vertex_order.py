"""In which order a body has its vertices: what `offsets` (T, V, 3) mean is nothing without it.

SMPL and the embedded bodies have 6,890 vertices and 13,776 faces each, in different orders. Offsets
of one added to the other's template are garbage of the right shape, so whatever holds offsets holds
this digest, and whoever puts them on a body compares it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import BodyModelData
from bridge.errors import DsnetError
from bridge.runs.files import arrays_sha256

VERTICES = "vertices"
"""What manifests and files call the digest."""


def vertex_order(body: BodyModelData) -> str:
    """SHA-256 of how many vertices a body has and which of them each face joins.

    Faces are taken as a set: each begins with its smallest vertex, and all are sorted. Places of
    the template are left out on purpose. Those of women and men, of SMPL and SMPL-H, and of one
    model stored as float32 or float64 differ where the order is the same; another order has other
    faces, as no surface of a person looks the same from one of its vertices as from another, but
    in a mirror, which turns faces inside out.
    """
    faces = body.faces.astype(np.int64)
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return arrays_sha256(
        {"faces": _sorted_rows(turned), "count": np.array([body.vertex_count], np.int64)}
    )


def _sorted_rows(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return rows[np.lexsort(rows.T[::-1])]


def check_vertex_order(held: str, what: str, body: BodyModelData) -> None:
    """Refuse a body whose vertices are in another order than those of `what`."""
    if held != (own := vertex_order(body)):
        raise DsnetError(
            f"{what}, whose vertices have the order {held[:12]}, with {body.name}, whose is "
            f"{own[:12]}",
            "a body with the vertices of the one that was moved",
            "Pass that body, or predict again with --body BODY of this one.",
        )
