"""What an AMASS `.npz` holds, read and checked, in the file's own frame rate with z up.

SMPL-H's release stores `poses` (T, 156) and `mocap_framerate`, SMPL-X's (`*_stageii.npz`) `poses`
(T, 165) and `mocap_frame_rate`. All begin with the root's rotation and the 21 body joints: the
22 joints of the paper's pose vector. Hands, jaw and eyes follow and are dropped.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from bridge.errors import DsnetError
from bridge.motion.sample_files import motion_path
from bridge.paper import N_BETAS, N_JOINTS

_POSE_WIDTHS = {72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
_RATE_KEYS = ("mocap_framerate", "mocap_frame_rate")
# Motion capture runs at 30 to 480 frames a second; a slower "rate" is a duration or a slip.
_RATES_HZ = (1.0, 10_000.0)

Arrays = Mapping[str, NDArray]


@dataclass(frozen=True, eq=False)
class AmassFile:
    """The parameters of T frames."""

    pose: NDArray[np.float64]
    """(T, 22, 3) joint rotations, axis-angle, radians."""
    trans_m: NDArray[np.float64]
    """(T, 3) translation of the root, metres, z up."""
    betas: NDArray[np.float64]
    """(10,) first of the 16 (or 10) shape coefficients."""
    gender: str
    """`female`, `male`, `neutral`, or `unknown` where the file does not say."""
    fps: float
    """Frames per second."""
    dmpls: NDArray[np.float64] | None
    """(T, 8) DMPL soft tissue coefficients, where the file has them."""


def read_amass_file(path: Path) -> AmassFile:
    """Read and check one file, or a sample that comes with the package (`sample:walking`).

    Raises
    ------
    DsnetError
        If the file is missing, is not such an archive, or holds no usable motion.
    """
    # Other arrays (markers) may be large or pickled; they are not touched.
    wanted = {"poses", "trans", "betas", "gender", "dmpls", *_RATE_KEYS}
    with _opened(motion_path(path)) as archive:
        arrays = {key: archive[key] for key in wanted & set(archive.files)}
    pose, trans_m = _pose(path, arrays)
    return AmassFile(
        pose=pose,
        trans_m=trans_m,
        betas=_betas(path, arrays),
        gender=_gender(arrays),
        fps=_rate(path, arrays),
        dmpls=_numbers(path, arrays, "dmpls", len(pose)) if "dmpls" in arrays else None,
    )


def gender_of_motion(path: Path) -> str | None:
    """The gender that a file states, or None if it has no `poses` and so is no motion.

    Raises
    ------
    DsnetError
        If the file is not a readable `.npz`.
    """
    with _opened(path) as archive:
        arrays = {key: archive[key] for key in {"gender"} & set(archive.files)}
        return _gender(arrays) if "poses" in archive.files else None


@contextmanager
def _opened(path: Path) -> Iterator[NpzFile]:
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            yield archive
    except FileNotFoundError as error:
        raise _unusable(path, "which does not exist", "Check the path.") from error
    except IsADirectoryError as error:
        raise _unusable(path, "which is a folder", "Name one file in it.") from error
    except (zipfile.BadZipFile, zlib.error) as error:
        raise _unusable(path, f"which is damaged ({error})") from error
    # A foreign or hostile file can fail inside NumPy's reader in any way at all.
    except Exception as error:
        raise _unusable(path, f"which does not load ({error})") from error


def _unusable(path: Path, flaw: str, remedy: str = "Download the file again.") -> DsnetError:
    return DsnetError(f"{path}, {flaw}", "an AMASS motion file (.npz) without pickles", remedy)


def _numbers(
    path: Path, arrays: Arrays, key: str, frame_count: int | None = None
) -> NDArray[np.float64]:
    if key not in arrays:
        raise _unusable(
            path, f"which has no {key!r}", "Pass a motion, not a shape or a model file."
        )
    array = arrays[key]
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise _unusable(path, f"whose {key!r} are not all finite numbers")
    if frame_count is not None and (array.ndim != 2 or len(array) != frame_count):
        raise _unusable(
            path, f"whose {key!r} have shape {array.shape} beside {frame_count} frames of poses"
        )
    return array.astype(np.float64)


def _pose(path: Path, arrays: Arrays) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Joint rotations (T, 22, 3) and translations (T, 3)."""
    poses = _numbers(path, arrays, "poses")
    if poses.ndim != 2 or poses.shape[1] not in _POSE_WIDTHS:
        known = ", ".join(f"{width} ({model})" for width, model in _POSE_WIDTHS.items())
        raise DsnetError(
            f"{path}, whose 'poses' have shape {poses.shape}",
            f"(frames, width) with a width of {known}",
            "Pass a file of AMASS's SMPL-H or SMPL-X release.",
        )
    if not len(poses):
        raise _unusable(path, "which has zero frames", "Pass a motion with at least one frame.")
    trans_m = _numbers(path, arrays, "trans", len(poses))
    if trans_m.shape[1] != 3:
        raise _unusable(path, f"whose 'trans' have shape {trans_m.shape}")
    return poses[:, : 3 * N_JOINTS].reshape(-1, N_JOINTS, 3), trans_m


def _rate(path: Path, arrays: Arrays) -> float:
    key = next((key for key in _RATE_KEYS if key in arrays), None)
    if key is None:
        raise _unusable(path, f"which has neither {' nor '.join(_RATE_KEYS)}", "Add its rate, Hz.")
    rate = _numbers(path, arrays, key)
    if rate.size != 1 or not _RATES_HZ[0] <= rate.item() <= _RATES_HZ[1]:
        raise _unusable(path, f"whose {key} is {rate.tolist()}", "Write its rate, Hz.")
    return rate.item()


def _betas(path: Path, arrays: Arrays) -> NDArray[np.float64]:
    betas = _numbers(path, arrays, "betas")
    if betas.size < N_BETAS or betas.size != betas.shape[-1]:
        raise _unusable(
            path,
            f"whose 'betas' have shape {betas.shape}",
            f"Store one vector of {N_BETAS} or more coefficients.",
        )
    return betas.ravel()[:N_BETAS]


def _gender(arrays: Arrays) -> str:
    stored = arrays.get("gender", np.array("unknown"))
    value = stored.item() if stored.size == 1 else "unknown"
    text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
    gender = text.strip().lower()
    return gender if gender in ("female", "male", "neutral") else "unknown"
