"""Where Gauss-Newton begins: every bone turned onto its own vertices, in closed form."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_align_ae.alignment.robust.sample import Pose, Shaped, SkinSample
from torch_align_ae.body.rotations import nearest_rotation


def initial_pose(sample: SkinSample, shaped: Shaped, target: Tensor) -> Pose:
    """Poses that turn each bone as its vertices are turned: orthogonal Procrustes, bone by bone.

    Blended skinning and pose blend shapes are left out, so joints are a few degrees off.

    Parameters
    ----------
    target : (B, 3, N) sample of the meshes, metres.
    """
    share = sample.weights.square()
    share = share / share.sum(1, keepdim=True)
    source = share @ shaped.vertices.T
    centre = torch.einsum("jn,bxn->bjx", share, target)
    spread = torch.einsum("jn,bxn,yn->bjxy", share, target, shaped.vertices)
    turn = nearest_rotation(spread - centre[..., None] * source[:, None])
    rotations = turn.clone()
    rotations[:, 1:] = turn[:, list(sample.parents[1:])].mT @ turn[:, 1:]
    root = shaped.joints[0]
    # The root turns about its own joint: R (x - root) + root + trans.
    trans = centre[:, 0] - turn[:, 0] @ (source[0] - root) - root
    return Pose(rotations, trans)
