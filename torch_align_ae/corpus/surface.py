"""What diffuses over a triangle mesh."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2

Array = NDArray[np.floating]


def smooth_over_surface(
    values: Array, vertices: Array, faces: NDArray[np.integer], length_m: float
) -> Array:
    """Diffuse `values` (V,) or (V, n) along the surface over about `length_m`."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = mass + length_m**2 * cotangent_laplacian(vertices, faces)
    return splu(system.tocsc()).solve(mass @ values)
