"""Unposing: the inverse skinning W^-1 of Eq. 5; twin of `torch_align_ae/body/smpl.py`."""

from __future__ import annotations

from tf_dsnet.framework import Tensor, tf
from tf_dsnet.smpl import KerasSMPL

# A half-and-half blend of two rotations phi apart has determinant cos^2(phi / 2): below this
# one (phi above 176 degrees) the inverse would blow up a millimetre to three centimetres.
_SINGULAR_BELOW = 1e-3


def unpose(smpl: KerasSMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor) -> Tensor:
    """Rest-pose vertices of a posed mesh: each vertex's blended transform is inverted.

    Where skinning has collapsed a vertex (bones turned half round against each other), the
    collapsed directions cannot be seen in the posed mesh; there the result keeps KerasSMPL's own
    rest-pose vertex, so its offset is zero in these directions.

    Parameters
    ----------
    smpl : the body model.
    vertices : (B, V, 3) posed mesh, metres.
    betas, pose, trans : as in `KerasSMPL`.

    Returns
    -------
    (B, V, 3) rest-pose vertices, metres. The pose blend shapes stay in them.

    Raises
    ------
    DsnetError
        If an argument has the wrong shape.
    """
    vertices = smpl.checked("vertices", vertices, (len(betas), smpl.vertex_count, 3))
    rotations = smpl.rotations(pose)
    blended = tf.transpose(smpl.blended_transforms(betas, rotations, trans), (0, 3, 1, 2))
    matrix, moved = tf.split(blended, (3, 1), axis=-1)  # (B, V, 3, 3), (B, V, 3, 1)
    centred = vertices - tf.squeeze(moved, -1)
    singular = _is_singular(matrix)
    invertible = tf.where(singular[..., None, None], tf.eye(3, dtype=smpl.dtype), matrix)
    solved = tf.squeeze(tf.linalg.solve(invertible, tf.expand_dims(centred, -1)), -1)

    collapsed = tf.where(singular)
    rest = tf.transpose(smpl.planar_rest(betas, rotations), (0, 2, 1))
    kept = _least_change(*(tf.gather_nd(values, collapsed) for values in (matrix, centred, rest)))
    return tf.tensor_scatter_nd_update(solved, collapsed, kept)


def _is_singular(matrix: Tensor) -> Tensor:
    """(...,) whether (..., 3, 3) matrices collapse something."""
    a, b, c = tf.unstack(matrix, axis=-1)
    return tf.abs(tf.reduce_sum(a * tf.linalg.cross(b, c), -1)) < _SINGULAR_BELOW


def _least_change(matrix: Tensor, centred: Tensor, start: Tensor) -> Tensor:
    """The point (N, 3) nearest to `start` that `matrix` takes as near to `centred` as it can."""
    residual = centred - tf.linalg.matvec(matrix, start)
    inverse = tf.linalg.pinv(matrix, rcond=_SINGULAR_BELOW**0.5)
    return start + tf.linalg.matvec(inverse, residual)
