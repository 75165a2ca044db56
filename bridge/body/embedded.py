"""The free bodies that ship with the project, and the one way to load any body model.

`assets/embedded_{female,male}.npz` are made by `tools/build_embedded_body.py`; both share faces.
Layout of an asset (plain arrays, no pickles):

===================== ================ ==========================================================
`v_template`          float32 (V, 3)   metres
`faces`               uint16 (F, 3)
`shapedirs`           int16 (10, V, 3) in steps of `shapedirs_step_m`
`posedirs`            int16 (27, N)    (x, y, z) by the 9 entries of R - I, in `posedirs_step_m`
`posedirs_vertex`     uint16 (N,)      vertex of each column, joint 1's vertices first
`posedirs_count`      uint16 (23,)     number of columns that belong to joints 1..23
`weight_joint`        uint8 (V, K)     joints that move each vertex
`weight_value`        uint16 (V, K)    their weights, up to a factor
`regressor_vertex`    uint16 (24, R)   vertices around each joint
`regressor_value`     float32 (24, R)  their signed weights, up to a factor
`makehuman_index`     uint16 (V,)      index of each vertex in MakeHuman's base mesh
===================== ================ ==========================================================

`assets/embedded_texture.npz` says how pictures of skin lie on either, MakeHuman's and those of
`bridge/body/skin.py`: `places` uint16 (T, 2), in 65535ths, and `corners` uint16 (F, 3).
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bridge.body.body_folders import find_body_file
from bridge.body.model_data import (
    JOINT_COUNT,
    POSE_FEATURE_COUNT,
    SMPL_PARENTS,
    BodyModelData,
    Texture,
)
from bridge.body.smpl_files import load_smpl_file
from bridge.errors import DsnetError
from bridge.paper import N_BETAS, N_VERTICES
from bridge.runs.untrusted import UntrustedNpz, open_npz

EMBEDDED = "embedded"
"""The body model of whichever gender is meant."""
EMBEDDED_PREFIX = EMBEDDED + ":"
EMBEDDED_GENDERS = ("female", "male")


def load_body_model(
    name_or_path: str | Path, gender: str | None = None, kind: str | None = None
) -> BodyModelData:
    """Load `embedded:female`, `embedded:male`, `embedded` of a motion's `gender`, a model file of
    SMPL, SMPL-H or SMPL-X, or the file of a folder that fits `gender` and `kind` (`smpl`, `smplh`,
    `smplx`).

    `notes` of the result say which file was taken, and what else is unusual about it.

    Raises
    ------
    DsnetError
        If there is no such embedded body, or none of that gender in the folder, or the file is
        missing, damaged, unsafe, another model's, or no person in metres.
    """
    name = str(name_or_path)
    if name == EMBEDDED:
        name = EMBEDDED_PREFIX + embedded_gender(gender or "")[0]
    if not name.startswith(EMBEDDED_PREFIX):
        is_folder = False
        with suppress(OSError):  # a name that none can have
            is_folder = Path(name).is_dir()
        if not is_folder:
            return load_smpl_file(name)
        path, note = find_body_file(Path(name), gender, kind)
        body = load_smpl_file(path)
        return replace(body, notes=(note, *body.notes))
    gender = name.removeprefix(EMBEDDED_PREFIX)
    if gender not in EMBEDDED_GENDERS:
        raise DsnetError(
            f"body model {name}",
            " or ".join(EMBEDDED_PREFIX + known for known in EMBEDDED_GENDERS),
            "Choose one of these or give the path of an SMPL model file",
        )
    with _open_asset(gender) as archive:
        body = unpack(gender, {name: archive.array(name) for name in archive})
    return replace(body, texture=embedded_texture())


def embedded_texture() -> Texture:
    """The texture coordinates that both embedded bodies have."""
    with _open_asset("texture") as texture:
        places, corners = texture.array("places") / 65535, texture.array("corners")
    return Texture(places, corners.astype(np.int64))


def load_paper_body(path: str | Path) -> BodyModelData:
    """A body for meshes of Dyna and the paper's networks, which know SMPL's 6890 vertices by
    number, with as many shapes as the paper has; `DsnetError` of another."""
    embedded = str(path).startswith(EMBEDDED_PREFIX)
    body = load_body_model(path) if embedded else load_smpl_file(path)
    if body.kind != "smpl" or body.vertex_count != N_VERTICES:
        raise DsnetError(
            f"body model {path}: {body.kind} of {body.vertex_count} vertices",
            f"SMPL's {JOINT_COUNT} joints and {N_VERTICES} vertices, as Dyna's meshes have them",
            "Pass the SMPL model from smpl.is.tue.mpg.de",
        )
    return body.with_shapes(N_BETAS)


def embedded_gender(gender: str) -> tuple[str, str | None]:
    """`female` or `male` for a motion's gender; where it is neither, `female`, and for `neutral`,
    which no embedded body is, a line that says so."""
    if gender in EMBEDDED_GENDERS:
        return gender, None
    taken, other = EMBEDDED_GENDERS
    line = f"a neutral body's motion is put on {EMBEDDED_PREFIX}{taken}"
    how = f"--gender {other} or --body takes another"
    return taken, f"{line}: {how}" if gender == "neutral" else None


def unpack(gender: str, arrays: Mapping[str, np.ndarray]) -> BodyModelData:
    """Rebuild the model from an asset's arrays; see the module's table."""
    vertex_count, joints = len(arrays["v_template"]), np.arange(JOINT_COUNT)
    shapedirs = arrays["shapedirs"] * float(arrays["shapedirs_step_m"])
    by_turn = (arrays["posedirs"] * float(arrays["posedirs_step_m"])).T.reshape(-1, 3, 9)
    posedirs = np.zeros((vertex_count, JOINT_COUNT - 1, 3, 9))
    joint = np.repeat(joints[:-1], arrays["posedirs_count"])
    posedirs[arrays["posedirs_vertex"], joint] = by_turn
    weights = np.zeros((vertex_count, JOINT_COUNT))
    mover, value = arrays["weight_joint"].astype(np.int64), arrays["weight_value"]
    np.put_along_axis(weights, mover, value.astype(np.float64), axis=1)
    around = arrays["regressor_value"].astype(np.float64)
    around /= around.sum(axis=1, keepdims=True)
    place = np.repeat(joints, around.shape[1]), arrays["regressor_vertex"].astype(np.int64).ravel()
    return BodyModelData(
        name=EMBEDDED_PREFIX + gender,
        source="synthetic",
        gender=gender,
        v_template=arrays["v_template"],
        shapedirs=np.ascontiguousarray(np.moveaxis(shapedirs, 0, -1)),
        posedirs=posedirs.transpose(0, 2, 1, 3).reshape(vertex_count, 3, POSE_FEATURE_COUNT),
        J_regressor=sp.csr_matrix((around.ravel(), place), shape=(JOINT_COUNT, vertex_count)),
        weights=weights / weights.sum(axis=1, keepdims=True),
        faces=arrays["faces"],
        parents=np.array(SMPL_PARENTS),
    )


def _open_asset(name: str) -> AbstractContextManager[UntrustedNpz]:
    asset = resources.files("bridge.body") / "assets" / f"embedded_{name}.npz"
    return open_npz(str(asset))
