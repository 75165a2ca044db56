"""AMASS `.npz`, and the short synthetic motions of the package, which are such files.

SMPL-H's release stores `poses` (T, 156) and `mocap_framerate`, SMPL-X's (`*_stageii.npz`) `poses`
(T, 165) and `mocap_frame_rate`. All begin with the root's rotation and the 21 body joints: the
22 joints of the paper's pose vector. Hands, jaw and eyes follow and are dropped.

`python tools/build_sample_motions.py` makes the samples.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.errors import DsnetError, did_you_mean
from bridge.motion.motion import (
    FARTHEST_M,
    HIGHEST_M,
    LARGEST_ANGLE_RAD,
    LARGEST_BETA,
    MOST_FRAMES,
    RATES_HZ,
    Motion,
    pack_theta,
)
from bridge.paper import N_BETAS, N_JOINTS
from bridge.runs.untrusted import UntrustedNpz, damage_refused, open_npz, text_of

SUFFIXES = (".npz",)
SAMPLE_PREFIX = "sample:"
CYCLE = "walk_cycle"
"""The one that repeats, in place: its last frame is its first again."""
SAMPLES = ("dancing", "jumping_jacks", CYCLE, "walking")

_POSE_WIDTHS = {72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
_RATE_KEYS = ("mocap_framerate", "mocap_frame_rate")
_BYTES_A_FRAME = 8 * max(_POSE_WIDTHS)
_MOST_BYTES = {"poses": MOST_FRAMES * _BYTES_A_FRAME, "trans": MOST_FRAMES * 24}
_MOST_BYTES |= {"dmpls": MOST_FRAMES * 64, "betas": 1 << 16}
_MOST_TEXT_BYTES = 1 << 12
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}

Arrays = Mapping[str, NDArray]


def sniff(path: Path) -> bool:
    """By its name."""
    return str(path).startswith(SAMPLE_PREFIX) or path.suffix in SUFFIXES


def read(path: Path) -> Motion:
    """Read and check one file, or a sample that comes with the package (`sample:walking`)."""
    # Other arrays (markers) may be large or pickled; they are not touched.
    wanted = ("poses", "trans", "betas", "gender", "dmpls", *_RATE_KEYS)
    with _opened(path, motion_path(path)) as archive:
        arrays = _arrays(archive, wanted)
    return motion_of(path, arrays)


def motion_of(path: Path, arrays: Arrays) -> Motion:
    """The motion in the arrays of a file, by AMASS's names; `DsnetError` if it is none."""
    pose, trans_m = _pose(path, arrays)
    betas, gender, fps = _betas(path, arrays), _gender(arrays), _rate(path, arrays)
    return Motion(
        theta=pack_theta(pose, trans_m),
        betas=betas,
        gender=gender,
        fps=fps,
        source_fps=fps,
        source=path,
        up="z",
        dmpls=_numbers(path, arrays, "dmpls", len(pose)) if "dmpls" in arrays else None,
    )


def gender_of(path: Path) -> str | None:
    """The gender that a file states, or None if it has no `poses` and so is no motion."""
    with _opened(path, path) as archive:
        return _gender(_arrays(archive, ("gender",))) if "poses" in archive else None


def motion_path(name_or_path: Path | str) -> Path:
    """The file of `sample:walking` and the like; any other path as it is."""
    name = str(name_or_path)
    if not name.startswith(SAMPLE_PREFIX):
        return Path(name_or_path)
    sample = name.removeprefix(SAMPLE_PREFIX)
    if sample not in SAMPLES:
        known = ", ".join(SAMPLE_PREFIX + sample for sample in SAMPLES)
        remedy = did_you_mean(
            sample, SAMPLES, "Name one of these, or an AMASS file.", SAMPLE_PREFIX
        )
        raise DsnetError(f"motion {name}", known, remedy)
    return sample_path(sample)


def sample_path(name: str) -> Path:
    """Where a sample lies, or will when it is built."""
    return Path(str(resources.files("bridge.motion"))) / "samples" / f"{name}.npz"


@contextmanager
def _opened(path: Path, file: Path) -> Iterator[UntrustedNpz]:
    """The archive; `path` is the name that the user knows it by."""
    with damage_refused(partial(_unreadable, path)), open_npz(file) as archive:
        yield archive


def _arrays(archive: UntrustedNpz, wanted: tuple[str, ...]) -> dict[str, NDArray]:
    """Those of the wanted arrays that there are, none of which is read before all are checked."""
    there = [key for key in wanted if key in archive]
    for key in there:
        archive.check(key, _MOST_BYTES.get(key, _MOST_TEXT_BYTES))
    return {key: archive.array(key) for key in there}


def _unreadable(path: Path, error: Exception) -> DsnetError:
    if isinstance(error, FileNotFoundError):
        # It may be a sample's name alone.
        named = () if path.suffix else SAMPLES
        remedy = did_you_mean(str(path), named, "Check the path.", SAMPLE_PREFIX)
        return _unusable(path, "which does not exist", remedy)
    if isinstance(error, IsADirectoryError):
        return _unusable(path, "which is a folder", "Name one file in it.")
    if isinstance(error, (zipfile.BadZipFile, zlib.error)):
        return _unusable(path, f"which is damaged ({error})")
    return _unusable(path, f"which does not load ({str(error)[:200]})")


def _unusable(path: Path, flaw: str, remedy: str = "Download the file again.") -> DsnetError:
    return DsnetError(f"{path}, {flaw}", "an AMASS motion file (.npz) without pickles", remedy)


def _numeric(path: Path, arrays: Arrays, key: str) -> NDArray:
    if key not in arrays:
        remedy = "Pass a motion, not a shape or a model file."
        raise _unusable(path, f"which has no {key!r}", remedy)
    if arrays[key].dtype.kind not in "iuf":
        raise _unusable(path, f"whose {key!r} are not all finite numbers")
    return arrays[key]


def _numbers(
    path: Path, arrays: Arrays, key: str, frame_count: int | None = None
) -> NDArray[np.float64]:
    array = _numeric(path, arrays, key)
    if not np.isfinite(array).all():
        raise _unusable(path, f"whose {key!r} are not all finite numbers")
    if frame_count is not None and (array.ndim != 2 or len(array) != frame_count or not array.size):
        raise _unusable(
            path, f"whose {key!r} have shape {array.shape} beside {frame_count} frames of poses"
        )
    return array.astype(np.float64)


def _pose(path: Path, arrays: Arrays) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Joint rotations (T, 22, 3) and translations (T, 3) that a body can take."""
    shape = _numeric(path, arrays, "poses").shape
    if len(shape) != 2 or shape[1] not in _POSE_WIDTHS:
        known = ", ".join(f"{width} ({model})" for width, model in _POSE_WIDTHS.items())
        raise DsnetError(
            f"{path}, whose 'poses' have shape {shape}",
            f"(frames, width) with a width of {known}",
            "Pass a file of AMASS's SMPL-H or SMPL-X release.",
        )
    if shape[0] > MOST_FRAMES:
        raise DsnetError(
            f"{path}, a motion of {shape[0]} frames",
            f"at most {MOST_FRAMES}",
            "Cut it into several files.",
        )
    # Without hands and face, which take three fifths of the memory.
    poses = _numbers(path, {"poses": arrays["poses"][:, : 3 * N_JOINTS]}, "poses")
    if not len(poses):
        raise _unusable(path, "which has zero frames", "Pass a motion with at least one frame.")
    trans_m = _numbers(path, arrays, "trans", len(poses))
    if trans_m.shape[1] != 3:
        raise _unusable(path, f"whose 'trans' have shape {trans_m.shape}")
    # The largest entry: squares of what a hostile file holds overflow.
    if (angle_rad := np.abs(poses).max()) > LARGEST_ANGLE_RAD:
        flaw = f"whose 'poses' turn a joint by {angle_rad:.3g} rad"
        raise _unusable(path, flaw, f"Angles are radians, at most {LARGEST_ANGLE_RAD:g}.")
    far_m, height_m = np.abs(trans_m).max(), abs(float(np.median(trans_m[:, 2])))
    if far_m > FARTHEST_M or height_m > HIGHEST_M:
        # The unit in which a body's root is as high above the floor as hips are.
        likely = [unit for unit, per_m in _UNITS.items() if 0.2 < height_m / per_m < 2.0]
        remedy = f"it seems to be in {likely[0]}" if likely else "convert it"
        raise _unusable(
            path,
            f"whose 'trans' are {far_m:.3g} m off, {height_m:.3g} m high over half of the time",
            f"Expected are metres, z up, at most {FARTHEST_M:g} off and {HIGHEST_M:g} high: "
            f"{remedy}.",
        )
    return poses.reshape(-1, N_JOINTS, 3), trans_m


def _rate(path: Path, arrays: Arrays) -> float:
    key = next((key for key in _RATE_KEYS if key in arrays), None)
    if key is None:
        raise _unusable(path, f"which has neither {' nor '.join(_RATE_KEYS)}", "Add its rate, Hz.")
    rate = _numbers(path, arrays, key)
    if rate.size != 1 or not RATES_HZ[0] <= rate.item() <= RATES_HZ[1]:
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
    first = betas.ravel()[:N_BETAS]
    if (largest := np.abs(first).max()) > LARGEST_BETA:
        raise _unusable(path, f"whose 'betas' reach {largest:.3g}", "Store a person's, within 5.")
    return first


def _gender(arrays: Arrays) -> str:
    stored = arrays.get("gender", np.array("unknown"))
    return gender_in(text_of(stored)) if stored.size == 1 else "unknown"


def gender_in(stated: object) -> str:
    """What a file's word for a gender means."""
    word = stated.strip().lower() if isinstance(stated, str) else ""
    return word if word in ("female", "male", "neutral") else "unknown"
