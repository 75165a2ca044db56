"""Absorption: how much of the true offsets ends in the pose and the shape instead (Section 6).

Alignment can explain a jiggling breast by an offset or by a nodding spine. With D the true offset
of a vertex in a frame, D' the estimated one and a = D - D' what became of the difference,

    absorbed = sum a . D / sum |D|^2          0: all of D came back, 1: pose and shape took it all
    invented = rms |D' - (1 - absorbed) D|    what the estimate has that is not in proportion to D

over any set of vertices and frames. The two do not overlap: invented is perpendicular to D, so
1 - R2 = sum |a|^2 / sum |D|^2 = absorbed^2 + sum |invented|^2 / sum |D|^2. Of a, the part
S(beta') - S(beta) is the shape's; the rest is the pose's. An energy ratio alone would not tell
dynamics that were lost from errors that have nothing to do with them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES

# Of a part that holds less of the body's energy, no share can be told: it hardly moves.
_LEAST_SHARE = 5e-3


class Absorption:
    """Running sums of one aligner's offsets against the true ones, for each vertex.

    Parameters
    ----------
    body : the body model; a vertex belongs to the part of the joint with its largest weight.
    """

    def __init__(self, body: BodyModelData) -> None:
        self._shapedirs = body.shapedirs
        self._part_of_vertex = body.weights.argmax(axis=1)
        self._frames = 0
        self._true, self._error, self._taken, self._taken_by_shape = np.zeros(
            (4, body.vertex_count)
        )

    def add(
        self, found_m: ArrayLike, true_m: ArrayLike, found_betas: ArrayLike, true_betas: ArrayLike
    ) -> None:
        """Take in frames of one sequence.

        Parameters
        ----------
        found_m, true_m : (T, V, 3) offsets in the rest pose, metres.
        found_betas, true_betas : (10,) shape, or (T, 10) when each frame has its own.
        """
        true = np.asarray(true_m, dtype=np.float64)
        difference = true - np.asarray(found_m, dtype=np.float64)
        change = np.subtract(found_betas, true_betas, dtype=np.float64)
        by_shape = np.tensordot(np.atleast_2d(change), self._shapedirs, axes=(-1, -1))
        self._frames += len(true)
        self._true += np.einsum("tvx,tvx->v", true, true)
        self._error += np.einsum("tvx,tvx->v", difference, difference)
        self._taken += np.einsum("tvx,tvx->v", difference, true)
        self._taken_by_shape += np.einsum("tvx,tvx->v", np.broadcast_to(by_shape, true.shape), true)

    def merge(self, other: Absorption) -> None:
        """Take in all frames of `other`."""
        for name in ("_frames", "_true", "_error", "_taken", "_taken_by_shape"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def rms_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Root mean square over frames of each vertex's true offset and of its error, (V,) m."""
        frames = max(self._frames, 1)
        return np.sqrt(self._true / frames), np.sqrt(self._error / frames)

    def of(self, vertices: NDArray[np.bool_] | slice = slice(None)) -> dict[str, float | None]:
        """Figures of some vertices (V,) bool, or of all.

        Returns
        -------
        dict
            `share` of the body's true energy; `true_mm`, `error_mm` and `invented_mm`, root mean
            squares; `r2`; `absorbed`, and of that `absorbed_by_pose`. What would be a ratio to
            nothing is None.
        """
        true, error, taken, by_shape = (
            float(sums[vertices].sum())
            for sums in (self._true, self._error, self._taken, self._taken_by_shape)
        )
        count = max(self._frames * len(self._true[vertices]), 1)
        share = true / max(float(self._true.sum()), np.finfo(float).tiny)
        tells = share >= _LEAST_SHARE
        # Where hardly anything moves, all that the estimate has is invented.
        invented = error - taken**2 / true if tells else error
        return {
            "share": share,
            "true_mm": 1e3 * float(np.sqrt(true / count)),
            "error_mm": 1e3 * float(np.sqrt(error / count)),
            "invented_mm": 1e3 * float(np.sqrt(max(invented, 0.0) / count)),
            "r2": 1.0 - error / true if tells else None,
            "absorbed": taken / true if tells else None,
            "absorbed_by_pose": (taken - by_shape) / true if tells else None,
        }

    def summary(self) -> dict[str, Any]:
        """`whole` body, and `parts` by name in SMPL's order, as `of` gives them."""
        parts = {
            name: self.of(own)
            for joint, name in enumerate(SMPL_JOINT_NAMES)
            if (own := self._part_of_vertex == joint).any()
        }
        return {"whole": self.of(), "parts": parts}
