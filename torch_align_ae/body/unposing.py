"""Unposing: the inverse skinning W^-1 of Eq. 5, and the offsets that it leaves."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from bridge.errors import DsnetError
from torch_align_ae.body.smpl import SMPL

# A half-and-half blend of two rotations phi apart has determinant cos^2(phi / 2): below this
# one (phi above 176 degrees) the inverse would blow up a millimetre to three centimetres.
_SINGULAR_BELOW = 1e-3


def unpose(smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor) -> Tensor:
    """Rest-pose vertices of a posed mesh: each vertex's blended transform is inverted.

    Where skinning has collapsed a vertex (bones turned half round against each other), the
    collapsed directions cannot be seen in the posed mesh; there the result keeps SMPL's own
    rest-pose vertex, so its offset is zero in these directions.

    Parameters
    ----------
    smpl : the body model.
    vertices : (B, V, 3) posed mesh, metres.
    betas, pose, trans : as in `SMPL.forward`.

    Returns
    -------
    (B, V, 3) rest-pose vertices, metres. The pose blend shapes stay in them.

    Raises
    ------
    DsnetError
        If an argument has the wrong shape.
    """
    return _unpose(smpl, vertices, betas, pose, trans).vertices.transpose(1, 2).contiguous()


def rest_pose_offsets(
    smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor
) -> tuple[Tensor, Tensor]:
    """Eq. 5: Delta = W^-1(S) - (T + M_S(beta) + M_P(theta)), and how far SMPL is from the mesh.

    Arguments and errors as in `unpose`.

    Returns
    -------
    (B, V, 3) offsets in the rest pose, metres, and (B, V) distances of the posed body's vertices
    from the mesh's, metres.
    """
    unposed = _unpose(smpl, vertices, betas, pose, trans)
    offsets = (unposed.vertices - unposed.rest).transpose(1, 2).contiguous()
    posed = (unposed.blended[:, :, :3] * unposed.rest[:, None]).sum(2)
    return offsets, (posed - unposed.centred).norm(dim=1)


class _Unposed(NamedTuple):
    """An unposed mesh, and what it was found from."""

    vertices: Tensor
    """(B, 3, V) rest-pose vertices."""
    rest: Tensor
    """(B, 3, V) SMPL's rest-pose vertices, Eq. 2."""
    blended: Tensor
    """(B, 3, 4, V) blended transforms, rest to world."""
    centred: Tensor
    """(B, 3, V) mesh less the blended translation."""


def _unpose(smpl: SMPL, vertices: Tensor, betas: Tensor, pose: Tensor, trans: Tensor) -> _Unposed:
    expected = (len(betas), smpl.vertex_count, 3)
    if tuple(vertices.shape) != expected:
        raise DsnetError(
            f"vertices of shape {tuple(vertices.shape)}", f"shape {expected}", "Check the mesh."
        )
    rotations = smpl.rotations(pose)
    rest = smpl.planar_rest(betas, rotations)
    blended = smpl.blended_transforms(betas, rotations, trans)
    centred = vertices.transpose(1, 2) - blended[:, :, 3]
    solved, singular = _solve(blended, centred)
    if singular.any():
        solved = _keep_collapsed(solved, singular, blended, centred, rest)
    return _Unposed(solved, rest, blended, centred)


def _solve(blended: Tensor, centred: Tensor) -> tuple[Tensor, Tensor]:
    """Cramer's rule at every vertex: (B, 3, V) solutions and (B, V) where they are singular."""
    a, b, c = blended[:, :, 0], blended[:, :, 1], blended[:, :, 2]
    b_c = torch.linalg.cross(b, c, dim=1)
    determinant = (a * b_c).sum(1)
    singular = determinant.abs() < _SINGULAR_BELOW
    divisor = torch.where(singular, torch.ones_like(determinant), determinant)
    numerators = [
        (centred * b_c).sum(1),
        (centred * torch.linalg.cross(c, a, dim=1)).sum(1),
        (centred * torch.linalg.cross(a, b, dim=1)).sum(1),
    ]
    return torch.stack(numerators, 1) / divisor[:, None], singular


def _keep_collapsed(
    result: Tensor, singular: Tensor, blended: Tensor, centred: Tensor, rest: Tensor
) -> Tensor:
    """Replace singular vertices by the least change of SMPL's rest vertex that explains them."""
    body, vertex = singular.nonzero(as_tuple=True)
    matrix = blended[body, :, :3, vertex]
    start = rest[body, :, vertex]
    residual = centred[body, :, vertex] - (matrix @ start[..., None])[..., 0]
    inverse = torch.linalg.pinv(matrix, rtol=_SINGULAR_BELOW**0.5)
    corrected = start + (inverse @ residual[..., None])[..., 0]
    return result.transpose(1, 2).index_put((body, vertex), corrected).transpose(1, 2)
