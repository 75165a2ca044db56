"""AMASS files: SMPL-H's and SMPL-X's releases, and what lies beside the motions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bridge.motion import Motion, load_motion
from bridge.motion.motion import HowRead


def _standing(frames: int, width: int) -> dict[str, np.ndarray]:
    """A T that stands on the floor, z up."""
    poses, trans = np.zeros((frames, width)), np.zeros((frames, 3))
    poses[:, 0], trans[:, 2] = np.pi / 2, 0.86
    return {"poses": poses, "trans": trans}


def smplh(frames: int = 5, fps: float = 120.0) -> dict[str, Any]:
    """The keys of an SMPL-H file, in a T; gender is stored as bytes."""
    return {
        **_standing(frames, 156),
        "betas": np.linspace(-1, 1, 16),
        "dmpls": np.zeros((frames, 8)),
        "gender": np.bytes_(b"female"),
        "mocap_framerate": fps,
        "framelabelsinmem": np.array([b"ARIEL", b"C7"]),
    }


def smplx(frames: int = 5, fps: float = 120.0) -> dict[str, Any]:
    """The keys of a `stageii` file, in a T; the markers are a pickled dictionary."""
    return {
        "gender": "female",
        "surface_model_type": "smplx",
        "mocap_frame_rate": fps,
        "mocap_time_length": frames / fps,
        "markers_latent": np.zeros((2, 3)),
        "latent_labels": np.array(["ARIEL", "C7"]),
        "markers_latent_vids": np.array({"ARIEL": 8969, "C7": 3832}, dtype=object),
        **_standing(frames, 165),
        "betas": np.linspace(-1, 1, 16),
        "num_betas": 16,
        "root_orient": np.zeros((frames, 3)),
        "pose_body": np.zeros((frames, 63)),
        "pose_hand": np.zeros((frames, 90)),
        "pose_jaw": np.zeros((frames, 3)),
        "pose_eye": np.zeros((frames, 6)),
    }


def smpl(frames: int = 5, fps: float = 120.0) -> dict[str, Any]:
    """An SMPL file of 72 numbers a frame and ten shape coefficients."""
    return {
        **_standing(frames, 72),
        "betas": np.linspace(-1, 1, 10),
        "gender": np.array("female"),
        "mocap_framerate": fps,
    }


def shape() -> dict[str, Any]:
    """`shape.npz` or `female_stagei.npz`: a subject's shape, without poses."""
    return {"betas": np.linspace(-1, 1, 16), "gender": "female"}


def save(path: Path, arrays: dict[str, Any], **changes: Any) -> Path:
    """Write the arrays with some exchanged; a change to None leaves that key out."""
    arrays = arrays | changes
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = {key: value for key, value in arrays.items() if value is not None}
    np.savez(path, **kept)
    return path


def load_amass_motion(
    path: Path | str, *, root_joint_m: ArrayLike | None = None, **options: Any
) -> Motion:
    """A file as z up, whatever its bodies do, made y up, about a root joint (3,) where given."""
    motion = load_motion(path, how=HowRead(up="z"), **options)
    return motion if root_joint_m is None else motion.about_root_joint(root_joint_m)


def load_as_it_lies(path: Path | str) -> Motion:
    """A file at 60 Hz that is not turned: as if it were y up."""
    return load_motion(path, how=HowRead(up="y"))
