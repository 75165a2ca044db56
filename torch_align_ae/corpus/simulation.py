"""From a pose sequence to the offsets of the tissue, and to the mesh that a scanner would see."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import shaped_vertices
from bridge.motion import unpack_theta
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.motions.plan import GRAVITY_M_S2
from torch_align_ae.corpus.soft_tissue import RATE_HZ, Array, SoftTissue
from torch_align_ae.corpus.tissue_parameters import tissue_parameters

_FRAMES_PER_BATCH = 32


class TissueSimulator:
    """The soft tissue of the subject of shape `betas` (10,), with a float64 body model.

    Its mechanics follow from the shape; with `gravity` turned limbs hang.
    """

    def __init__(
        self,
        smpl: SMPL,
        betas: Array,
        *,
        gravity: bool = True,
    ) -> None:
        self.smpl, self.betas, self._gravity = smpl, betas, gravity
        vertices = shaped_vertices(smpl.data, betas[None])[0]
        self.tissue = SoftTissue(vertices, smpl.data.faces, tissue_parameters(smpl.data, betas))

    def offsets(self, theta: Array, fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69).

        Its first pose was held until the tissue had come to rest.
        """
        substeps = round(RATE_HZ / fps)
        if not np.isclose(substeps * fps, RATE_HZ):
            raise ValueError(f"{RATE_HZ} Hz is not a multiple of {fps} fps")
        drive = rest_frame_drive(
            self.smpl, self.betas, theta, fps, self.tissue.free, gravity=self._gravity
        )
        result = np.zeros((len(theta), self.smpl.vertex_count, 3), np.float32)
        state = self.tissue.settled(drive[0])
        result[0, self.tissue.free] = state.offsets_m
        for frame in range(1, len(theta)):
            before, after = drive[frame - 1], drive[frame]
            for substep in range(substeps):
                share = (substep + 0.5) / substeps
                state = self.tissue.step(state, before + share * (after - before))
            result[frame, self.tissue.free] = state.offsets_m
        return result


def rest_frame_drive(
    smpl: SMPL,
    betas: Array,
    theta: Array,
    fps: float,
    selected: NDArray[np.integer],
    *,
    gravity: bool = True,
) -> Array:
    """R^T (g - x'') - g (T, N, 3), m/s^2: what skeleton and gravity do to tissue at rest's frame.

    It is computed for the `selected` (N,) vertices; without `gravity`, g is 0. A [1 2 1] / 4
    filter in time blunts impacts, as shoes, pads and joints do.
    """
    vertices, turns = skin(smpl, betas, theta, selected)
    acceleration = np.zeros_like(vertices)
    acceleration[1:-1] = (vertices[2:] - 2 * vertices[1:-1] + vertices[:-2]) * fps**2
    # Equal rows of a matrix product may differ in the last bit; stillness must not.
    same = (theta[1:] == theta[:-1]).all(axis=1)
    acceleration[1:-1][same[1:] & same[:-1]] = 0.0
    fall = np.array([0.0, -GRAVITY_M_S2 if gravity else 0.0, 0.0])[:, None]
    drive = np.empty_like(vertices)
    for start in range(0, len(theta), _FRAMES_PER_BATCH):
        window = slice(start, start + _FRAMES_PER_BATCH)
        drive[window] = (turns[window] * (fall - acceleration[window])[:, :, None]).sum(1) - fall
    blunted = drive.copy()
    blunted[1:-1] = (drive[:-2] + 2 * drive[1:-1] + drive[2:]) / 4
    return blunted.transpose(0, 2, 1)


def skin(
    smpl: SMPL, betas: Array, theta: Array, selected: NDArray[np.integer]
) -> tuple[Array, Array]:
    """Vertices (T, 3, N) and each vertex's blended rotation (T, 3, 3, N)."""
    frames, count = len(theta), len(selected)
    dtype = smpl.template.numpy().dtype
    # Filled in place: of a long sequence the turns alone are half a gigabyte.
    vertices, turns = np.empty((frames, 3, count), dtype), np.empty((frames, 3, 3, count), dtype)
    with torch.inference_mode():
        for start in range(0, frames, _FRAMES_PER_BATCH):
            window = slice(start, start + _FRAMES_PER_BATCH)
            shape, pose, trans = _tensors(smpl, betas, theta[window])
            rotations = smpl.rotations(pose)
            rest = smpl.planar_rest(shape, rotations)[..., selected]
            blended = smpl.blended_transforms(shape, rotations, trans)[..., selected]
            moved = (blended[:, :, :3] * rest[:, None]).sum(2) + blended[:, :, 3]
            vertices[window], turns[window] = moved.numpy(), blended[:, :, :3].numpy()
    return vertices, turns


def posed_meshes(
    smpl: SMPL, betas: Array, theta: Array, offsets_m: NDArray[np.floating]
) -> NDArray[np.float32]:
    """S_t = M(beta, theta_t) with the offsets posed alike (Eq. 1-2): (T, V, 3), metres."""
    meshes = np.zeros(offsets_m.shape, np.float32)
    with torch.inference_mode():
        for start in range(0, len(theta), _FRAMES_PER_BATCH):
            window = slice(start, start + _FRAMES_PER_BATCH)
            offsets = torch.from_numpy(np.asarray(offsets_m[window], np.float64))
            meshes[window] = smpl(*_tensors(smpl, betas, theta[window]), offsets).numpy()
    return meshes


def _tensors(
    smpl: SMPL, betas: Array, theta: Array
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    pose, trans = unpack_theta(theta)
    parts = (np.broadcast_to(betas, (len(theta), len(betas))), pose, trans)
    return tuple(torch.tensor(part, dtype=smpl.template.dtype) for part in parts)  # type: ignore


def body_in_double(data: BodyModelData) -> SMPL:
    """The body model that the corpus is made with."""
    return SMPL(data, dtype=torch.float64)
