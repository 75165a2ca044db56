"""From a pose sequence to the offsets of the tissue, and to the mesh that a scanner would see.

How soft a body is where follows from the depth of tissue over its bones.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import torch
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import cotangent_laplacian, vertex_areas_m2
from bridge.motion import unpack_theta
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.motions.plan import GRAVITY_M_S2
from torch_align_ae.corpus.soft_tissue import RATE_HZ, Array, SoftTissue, TissueParameters

_FRAMES_PER_BATCH = 32
BONY_HZ = 22.0
SOFT_HZ = 3.6
_DAMPING_RATIO = 0.11
# At an offset of 1/sqrt(a) = 2.6 cm the springs are twice as stiff as at rest.
_STIFFENING_PER_M2 = 1500.0
_WAVE_SPEED_M_S = 1.3
# Tissue moves freely from this depth on, metres.
_LOOSE_DEPTH_M = 0.075
_SMOOTHING_M = 0.03
# Below this looseness skin lies on bone and does not move at all.
_HELD_BELOW = 0.02
_BONY_JOINTS = (
    "head", "neck", "left_ankle", "right_ankle", "left_foot", "right_foot",
    "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
# Radius of bone and firm muscle about the line from a joint's parent to the joint; the trunk's
# is that of ribs and pelvis.
_FIRM_RADIUS_M = {
    "hip": 0.065, "knee": 0.048, "ankle": 0.042, "foot": 0.05, "spine1": 0.07, "spine2": 0.072,
    "spine3": 0.078, "neck": 0.07, "head": 0.07, "collar": 0.06, "shoulder": 0.055,
    "elbow": 0.032, "wrist": 0.032, "hand": 0.04,
}  # fmt: skip


class TissueSimulator:
    """The soft tissue of the subject of shape `betas` (10,), with a float64 body model.

    Its mechanics follow from the shape if no `parameters` are given; with `gravity` turned limbs
    hang.
    """

    def __init__(
        self,
        smpl: SMPL,
        betas: Array,
        parameters: TissueParameters | None = None,
        *,
        gravity: bool = True,
    ) -> None:
        self.smpl, self.betas, self._gravity = smpl, betas, gravity
        vertices = shaped_vertices(smpl.data, betas[None])[0]
        parameters = parameters or tissue_parameters(smpl.data, betas)
        self.tissue = SoftTissue(vertices, smpl.data.faces, parameters)

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


def tissue_parameters(data: BodyModelData, betas: Array) -> TissueParameters:
    """Mechanics of the tissue of the body with shape `betas` (10,)."""
    looseness = tissue_looseness(data, betas)
    count = len(looseness)
    return TissueParameters(
        # The geometric mean keeps half-deep tissue firmer than the arithmetic one would.
        frequency_hz=BONY_HZ * (SOFT_HZ / BONY_HZ) ** looseness,
        damping_ratio=np.full(count, _DAMPING_RATIO),
        stiffening_per_m2=np.full(count, _STIFFENING_PER_M2),
        wave_speed_m_s=_WAVE_SPEED_M_S,
        free=looseness >= _HELD_BELOW,
    )


def tissue_looseness(data: BodyModelData, betas: Array) -> Array:
    """(V,) 0 over bone, 1 where tissue is deep; smooth over the surface."""
    vertices = shaped_vertices(data, betas[None])[0]
    depth_m = tissue_depth_m(vertices, data.J_regressor @ vertices, data.parents)
    loose = np.clip(depth_m / _LOOSE_DEPTH_M, 0.0, 1.0)
    bony = [SMPL_JOINT_NAMES.index(name) for name in _BONY_JOINTS]
    loose *= np.clip(1 - 1.5 * data.weights[:, bony].sum(axis=1), 0.0, 1.0)
    return np.clip(smooth_over_surface(loose, vertices, data.faces, _SMOOTHING_M), 0.0, 1.0)


def tissue_depth_m(vertices: Array, joints: Array, parents: np.ndarray) -> Array:
    """(V,) distance from each vertex to the surface of the nearest bone, metres."""
    depth_m = np.full(len(vertices), np.inf)
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        bone = joints[joint] - joints[parent]
        share = np.clip((vertices - joints[parent]) @ bone / (bone @ bone), 0.0, 1.0)
        nearest = joints[parent] + share[:, None] * bone
        radius_m = _FIRM_RADIUS_M[SMPL_JOINT_NAMES[joint].split("_")[-1]]
        depth_m = np.minimum(depth_m, np.linalg.norm(vertices - nearest, axis=1) - radius_m)
    return depth_m


def smooth_over_surface(
    values: Array, vertices: Array, faces: NDArray[np.integer], length_m: float
) -> Array:
    """Diffuse `values` (V,) or (V, n) along the surface over about `length_m`."""
    mass = sp.diags(vertex_areas_m2(vertices, faces))
    system = mass + length_m**2 * cotangent_laplacian(vertices, faces)
    return splu(system.tocsc()).solve(mass @ values)
