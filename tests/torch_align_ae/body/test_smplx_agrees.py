"""smplx, the reference of those who made the models, poses the files as we do."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import torch

from bridge.body import BodyModelData, load_body_model, pose_vertices
from bridge.body.model_data import SKELETONS, Kind
from torch_align_ae import SMPL

smplx = pytest.importorskip("smplx")
_COUNTS: dict[Kind, int] = {"smpl": 6890, "smplh": 6890, "smplx": 10_475}
_PARTS = {
    "smpl": {"body_pose": 23},
    "smplh": {"body_pose": 21, "left_hand_pose": 15, "right_hand_pose": 15},
    "smplx": {
        "body_pose": 21, "jaw_pose": 1, "leye_pose": 1, "reye_pose": 1,
        "left_hand_pose": 15, "right_hand_pose": 15,
    },
}  # fmt: skip


def cloud(kind: Kind) -> BodyModelData:
    """Every term of a model on as many vertices as smplx asks for, in no order, off the origin."""
    rng, adult = np.random.default_rng(7), load_body_model("embedded:female")
    count, parents = _COUNTS[kind], np.array(SKELETONS[kind][1])
    at = np.resize(rng.permutation(6890), count)
    weights = np.zeros((count, len(parents)))
    movers = rng.integers(0, len(parents), (count, 3))
    np.add.at(weights, (np.arange(count)[:, None], movers), rng.dirichlet(np.ones(3), count))
    near = rng.integers(0, count, (len(parents), 4))
    rows = np.repeat(np.arange(len(parents)), 4)
    regressor = sp.csr_matrix((np.full(near.size, 0.25), (rows, near.ravel())))
    regressor.resize(len(parents), count)
    return BodyModelData(
        name=kind,
        source="synthetic",
        gender="female",
        v_template=adult.v_template[at] + [-0.002, -0.241, 0.029],
        shapedirs=adult.shapedirs[at],
        posedirs=rng.normal(0, 0.003, (count, 3, 9 * (len(parents) - 1))),
        J_regressor=regressor,
        weights=weights,
        faces=rng.integers(0, count, (100, 3)),
        parents=parents,
        expressiondirs=rng.normal(0, 0.01, (count, 3, 10 if kind == "smplx" else 0)),
        hands_mean=None if kind == "smpl" else rng.normal(0, 0.2, (30, 3)),
    )


def _read_by_smplx(body: BodyModelData, folder: Path) -> Any:
    """Its module, from the file that we write and what else it asks for."""
    path = folder / f"{body.kind.upper()}_FEMALE.pkl"
    body.save_smpl_pkl(path)
    fields = pickle.loads(path.read_bytes())
    fields |= {"hands_componentsl": np.eye(45), "hands_componentsr": np.eye(45)}
    fields |= {"lmk_faces_idx": np.zeros(51, int), "lmk_bary_coords": np.full((51, 3), 1 / 3)}
    path.write_bytes(pickle.dumps(fields, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy's, about how it makes tensors
        return smplx.create(
            str(path), body.kind, gender="female", ext="pkl", use_pca=False, flat_hand_mean=True,
            num_betas=10, dtype=torch.float64,
        )  # fmt: skip


@pytest.mark.parametrize("kind", ["smpl", "smplh", "smplx"])
def test_all_kinds_are_posed_as_by_smplx(tmp_path: Path, kind: Kind) -> None:
    body, rng = cloud(kind), np.random.default_rng(8)
    betas, trans = rng.normal(size=(1, 10)), rng.normal(size=(1, 3))
    pose = rng.normal(0, 0.4, (1, len(body.parents), 3))
    pose[0, 0] = 0.4, 1.2, 0.1
    parts, first = {"global_orient": pose[:, 0]}, 1
    for name, joints in _PARTS[kind].items():
        parts[name] = pose[:, first : first + joints].reshape(1, -1)
        first += joints
    assert first == len(body.parents)
    given = {name: torch.from_numpy(value) for name, value in parts.items()}
    module = _read_by_smplx(body, tmp_path)
    with torch.no_grad():
        expected = module(betas=torch.from_numpy(betas), transl=torch.from_numpy(trans), **given)
        ours = SMPL(body, torch.float64)(*map(torch.from_numpy, (betas, pose, trans)))
    expected = expected.vertices.numpy()
    np.testing.assert_allclose(pose_vertices(body, betas, pose, trans), expected, atol=1e-6)
    np.testing.assert_allclose(ours.numpy(), expected, atol=1e-6)
