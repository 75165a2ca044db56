"""From a pose sequence to the offsets of the third tissue law.

Between frames, places and axes follow cubic Hermite curves with the slopes of their neighbours, at
rest in the first frame; axes are then made orthonormal. Blended rotations are not orthogonal, and
the columns' axes turn with the nearest rotation, R. An offset is R^T (y - x) of that rotation: with
the blended matrix instead, which near a bent joint is almost singular, offsets would explode there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.laws.third_tissue import RATE_HZ, Array, ThirdTissue
from benchmarks.laws.third_tissue_parameters import third_tissue_parameters
from bridge.body import BodyModelData
from dsnet.synthetic.simulation import skin

_FRAMES_PER_BATCH = 32
_POLAR_STEPS = 8


class ThirdTissueSimulator:
    """The soft tissue of one subject under the third law.

    Parameters
    ----------
    body : body model.
    betas : (10,) shape of the subject.
    gravity : whether turned limbs hang.
    """

    def __init__(self, body: BodyModelData, betas: Array, *, gravity: bool = True) -> None:
        self.body, self.betas = body, betas
        self.free, parameters = third_tissue_parameters(body, betas)
        self.tissue = ThirdTissue(parameters, gravity=gravity)

    def offsets(self, theta: Array, fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69).

        Its first pose was held until the tissue had come to rest.

        Raises
        ------
        ValueError
            If 240 Hz is not a multiple of `fps`.
        """
        substeps = round(RATE_HZ / fps)
        if not substeps or not np.isclose(substeps * fps, RATE_HZ):
            raise ValueError(f"{RATE_HZ} Hz is not a multiple of {fps} fps")
        result = np.zeros((len(theta), self.body.vertex_count, 3), np.float32)
        frames = self._anchors(theta)
        start = next(frames)
        state = self.tissue.settled(*_split(start))
        result[0, self.free] = self._in_rest_pose(state.offsets_m[0][1])
        end, slope = next(frames, start), np.zeros_like(start)
        for frame in range(1, len(theta)):
            after = next(frames, end)
            # The last frame has no successor, and stops as it came.
            next_slope = (after - start) / 2 if frame + 1 < len(theta) else end - start
            for substep in range(1, substeps + 1):
                anchors = _hermite(start, end, slope, next_slope, substep / substeps)
                skin_m, axes = _split(anchors)
                state = self.tissue.step(state, skin_m, nearest_rotations(axes, steps=1))
            result[frame, self.free] = self._in_rest_pose(state.offsets_m[0][1])
            start, end, slope = end, after, next_slope
        return result

    def _in_rest_pose(self, components: Array) -> Array:
        """(N, 3) offsets of components (3, N) along the columns' axes."""
        return (self.tissue.parameters.axes * components).sum(1).T

    def _anchors(self, theta: Array) -> Iterator[Array]:
        """Each frame's anchors: (4, 3, N), the skin's place and the columns' three axes."""
        rest_axes = self.tissue.parameters.axes
        for start in range(0, len(theta), _FRAMES_PER_BATCH):
            window = theta[start : start + _FRAMES_PER_BATCH]
            places, turns = skin(self.body, self.betas, window, self.free)
            for skin_m, blended in zip(places, turns, strict=True):
                turn = nearest_rotations(blended)
                axes = (turn[:, :, None] * rest_axes).sum(1)
                yield np.concatenate([skin_m[None], axes.transpose(1, 0, 2)])


def nearest_rotations(matrices: Array, steps: int = _POLAR_STEPS) -> Array:
    """Rotations (3, 3, N) nearest to matrices of positive determinant, by Newton's iteration.

    A rotation stays what it is; one step is enough for what is one already but for a hundredth.
    """
    for _ in range(steps):
        cofactors = np.stack(
            [_cross(matrices[(row + 1) % 3], matrices[(row + 2) % 3]) for row in range(3)]
        )
        determinant = np.maximum((matrices[0] * cofactors[0]).sum(0), 1e-9)
        scale = np.cbrt(determinant)
        matrices = (matrices / scale + cofactors * (scale / determinant)) / 2
    return matrices


def _cross(first: Array, second: Array) -> Array:
    """Cross products of vectors (3, N)."""
    (a, b, c), (d, e, f) = first, second
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d])


def _split(anchors: Array) -> tuple[Array, Array]:
    """The skin's place (3, N), and the columns' axes (3, 3, N) as columns of a matrix."""
    return anchors[0], anchors[1:].transpose(1, 0, 2)


def _hermite(start: Array, end: Array, slope: Array, next_slope: Array, share: float) -> Array:
    """The cubic from start to end, with slopes a frame, at a share of the way."""
    way = end - start
    bend = slope + next_slope - 2 * way
    return start + share * (slope + share * (3 * way - 2 * slope - next_slope + share * bend))
