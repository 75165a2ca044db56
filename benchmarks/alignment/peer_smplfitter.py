"""smplfitter (Sarandi, MIT) as a peer: closed-form fitting of SMPL to registered meshes.

It is given what it needs to do well. It reads joints off the *posed* meshes, for which the
embedded body's regressor was not made (its signed weights hold in the rest pose only, and ten
iterations diverge with them), so a regressor for posed meshes is fitted and passed by the option
that smplfitter has for one. It never turns the toes against the feet, whatever the mesh does; the
comparison therefore also scores every aligner without the toes. It has no order in time: a whole
sequence is one batch, which was its fastest size. On the embedded body no vertex follows a collar
more than any other joint, and smplfitter reads a bone's twist from such vertices: part of its pose
error at collars and shoulders is that body's, not its own. Shapes are not regularised: the
default's pull towards the mean costs more here than it mends.
"""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import smplfitter.pt as smplfitter
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls
from torch import Tensor

from bridge.body import BodyModelData
from torch_align_ae.body import SMPL
from torch_align_ae.body.smpl import world_frames

_POSES, _ANGLE_RAD, _CANDIDATES = 120, 0.4, 200
# Spreads each joint's weights over tens of vertices, as SMPL's own regressor does.
_RIDGE = 0.1
_SUM_TO_ONE = 10.0
# A single frame at rest: this many iterations bring its shape within 0.005 of the truth.
_SHAPE_ITERATIONS = 30


@cache
def body_fitter(data: BodyModelData) -> smplfitter.BodyFitter:
    """smplfitter's fitter for a body model of ours, which it reads from SMPL's own format."""
    with tempfile.TemporaryDirectory() as folder:
        letter = data.gender[0]
        data.save_smpl_pkl(Path(folder) / f"basicmodel_{letter}_lbs_10_207_0_v1.1.0.pkl")
        np.save(Path(folder) / "kid_template.npy", data.v_template)
        model = smplfitter.BodyModel(
            "smpl",
            data.gender,
            model_root=folder,
            num_betas=10,
            joint_regressor_post_lbs=posed_joint_regressor(data),
        )
    return smplfitter.BodyFitter(model)


def first_frame_shape(fitter: smplfitter.BodyFitter, mesh: Tensor) -> Tensor:
    """(10,) shape of one mesh (V, 3) m, to be known from then on, as in the paper."""
    return fit_own_shape(fitter, mesh[None], _SHAPE_ITERATIONS)[0][0]


def fit_known_shape(
    fitter: smplfitter.BodyFitter, betas: Tensor, meshes: Tensor, iterations: int
) -> tuple[Tensor, Tensor, Tensor]:
    """betas (T, 10), pose (T, 24, 3) and translation (T, 3) m of meshes (T, V, 3) m whose shape
    (10,) is known."""
    shapes = betas.expand(len(meshes), -1)
    with torch.inference_mode():
        found = fitter.fit_with_known_shape(
            shape_betas=shapes,
            target_vertices=meshes,
            num_iter=iterations,
            requested_keys=["pose_rotvecs"],
        )
    return shapes, found["pose_rotvecs"].unflatten(1, (-1, 3)), found["trans"]


def fit_own_shape(
    fitter: smplfitter.BodyFitter, meshes: Tensor, iterations: int
) -> tuple[Tensor, Tensor, Tensor]:
    """The same when each frame's shape is fitted too."""
    with torch.inference_mode():
        found = fitter.fit(
            target_vertices=meshes,
            num_iter=iterations,
            beta_regularizer=0.0,
            requested_keys=["pose_rotvecs", "shape_betas"],
        )
    return found["shape_betas"], found["pose_rotvecs"].unflatten(1, (-1, 3)), found["trans"]


def posed_joint_regressor(data: BodyModelData) -> NDArray[np.float64]:
    """(24, V) non-negative weights that read joints off posed bodies, to millimetres.

    Least squares over random poses and shapes, from the vertices nearest to each joint.
    """
    vertices, joints = _posed_samples(data)
    regressor = np.zeros((len(data.parents), data.vertex_count))
    for joint, place in enumerate(data.joints):
        near = np.argsort(np.linalg.norm(data.v_template - place, axis=1))[:_CANDIDATES]
        arms = vertices[:, near] - joints[:, joint, None]
        equations = np.concatenate(
            [
                arms.transpose(0, 2, 1).reshape(-1, len(near)),
                _RIDGE * np.eye(len(near)),
                np.full((1, len(near)), _SUM_TO_ONE),
            ]
        )
        right = np.zeros(len(equations))
        right[-1] = _SUM_TO_ONE
        weights = nnls(equations, right)[0]
        regressor[joint, near] = weights / weights.sum()
    return regressor


def _posed_samples(data: BodyModelData) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Vertices (N, V, 3) and joints (N, 24, 3) of random bodies, metres."""
    rng = np.random.default_rng(0)
    smpl = SMPL(data, torch.float64)
    betas = torch.from_numpy(rng.normal(size=(_POSES, 10)))
    pose = torch.from_numpy(rng.normal(scale=_ANGLE_RAD, size=(_POSES, 24, 3)))
    trans = torch.zeros(_POSES, 3, dtype=torch.float64)
    _, places = world_frames(smpl.rotations(pose), smpl.joints(betas), smpl.parents, trans)
    return smpl(betas, pose, trans).numpy(), places.numpy()
