"""A motion from arrays of SMPL's family: its pose, its rate, whose shape, where and when."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.embedded import EMBEDDED_PREFIX
from bridge.motion.motion import (
    FARTHEST_M,
    HIGHEST_M,
    LARGEST_BETA,
    RATES_HZ,
    HowRead,
    Motion,
    UpAxis,
)
from bridge.motion.readers.joint_rotations import (
    axis_angles,
    by_joint,
    finite,
    unusable,
)
from bridge.motion.readers.smpl_fields import (
    BETAS_KEYS,
    LENGTH_KEY,
    RATE_KEYS,
    TRANS_KEYS,
    Arrays,
    first_of,
    gender_stored,
    text_in,
)
from bridge.motion.readers.smpl_poses import hands_and_face, pose_of, stated_kind
from bridge.motion.readers.tracks import frames_seen, of_one_person
from bridge.motion.readers.vertical import vertical_of
from bridge.motion.theta import pack_theta
from bridge.paper import N_BETAS
from bridge.runs.untrusted import text_of

_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
_SAME_BETAS, _SAME_RATE, _SAME_LENGTH = 0.05, 0.01, 0.05
_SAME_TURN_RAD = 1e-3


def motion_of(path: Path, arrays: Arrays, how: HowRead, usual_fps: float = np.nan) -> Motion:
    """A motion from arrays by name; `DsnetError` if they are none of a person.

    Parameters
    ----------
    usual_fps : the rate of files of this kind that do not say theirs.
    """
    notes: list[str] = []
    arrays = of_one_person(path, arrays, how, notes)
    arrays, numbers = frames_seen(path, arrays, notes)
    pose = pose_of(path, arrays)
    _refuse_second_turn(path, arrays, pose)
    kind, others = hands_and_face(path, arrays, len(pose), notes)
    kind = stated_kind(path, arrays, notes) or kind
    up, turn = vertical_of(path, arrays, pose, how, notes)
    trans_m = _trans(path, arrays, len(pose), up, notes)
    if turn is not None:
        rotation = Rotation.from_matrix(turn)
        pose[:, 0] = (rotation * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
        trans_m = rotation.apply(trans_m)
    betas, fps = _betas(path, arrays, notes), _rate(path, arrays, usual_fps, how, notes)
    length = arrays.get(LENGTH_KEY, np.array(np.nan))
    stated_s = float(length.item()) if length.size == 1 and length.dtype.kind in "iuf" else np.nan
    if abs(len(pose) / fps - stated_s) > _SAME_LENGTH * stated_s + 1 / fps:  # nan is not
        notes.append(
            f"{path} says that it lasts {stated_s:.4g} s, but {len(pose)} frames at {fps:g} a "
            f"second last {len(pose) / fps:.4g}: --motion-fps says another rate"
        )
    return Motion(
        theta=pack_theta(pose, trans_m),
        betas=np.pad(betas, (0, max(N_BETAS - len(betas), 0)))[:N_BETAS],
        more_betas=betas[N_BETAS:],
        kind=kind,
        hands_and_face=others,
        gender=gender_stored(arrays),
        fps=fps,
        source_fps=fps,
        source=path,
        up=up,
        dmpls=finite(path, "dmpls", arrays["dmpls"], len(pose)) if "dmpls" in arrays else None,
        trans_of=up,
        world_turn=turn,
        frame_numbers=numbers,
        embedded_betas=is_of_embedded(arrays),
        notes=tuple(notes),
    )


def is_of_embedded(arrays: Arrays) -> bool:
    """Whether the file says that it is of an embedded body, as this project's own."""
    return text_in(arrays, "source").startswith("synthetic") or text_in(
        arrays, "body_model"
    ).startswith(EMBEDDED_PREFIX)


def _refuse_second_turn(path: Path, arrays: Arrays, pose: NDArray[np.float64]) -> None:
    """Of EasyMocap's bodies; HY-Motion repeats the root's rotation under the same name."""
    if "Rh" not in arrays:
        return
    second = axis_angles(path, {"Rh": by_joint(path, "Rh", arrays["Rh"], 1)})[:, 0]
    is_same = len(second) == len(pose) and "Th" not in arrays
    if is_same:
        apart = Rotation.from_rotvec(second).inv() * Rotation.from_rotvec(pose[:, 0])
        is_same = apart.magnitude().max() < _SAME_TURN_RAD
    if not is_same:
        flaw = "whose bodies turn about the origin by 'Rh', as EasyMocap's"
        raise unusable(path, flaw, "Write them as 'root_orient' and 'trans' of SMPL.")


def _trans(
    path: Path, arrays: Arrays, frames: int, up: UpAxis, notes: list[str]
) -> NDArray[np.float64]:
    key = first_of(arrays, TRANS_KEYS)
    if key is None:
        notes.append(
            f"{path} says nowhere where the body is: it moves on the spot, --floor lifts it"
        )
        return np.zeros((frames, 3))
    trans_m = finite(path, key, arrays[key], frames)
    if trans_m.shape[1] != 3:
        raise unusable(path, f"whose {key!r} have shape {trans_m.shape}")
    if (scaling := arrays.get("smpl_scaling")) is not None:  # AIST++'s bodies are in centimetres
        per_m = finite(path, "smpl_scaling", scaling)
        if per_m.size != 1 or not 0.01 < per_m.item() < 1e4:
            raise unusable(path, f"whose 'smpl_scaling' is {per_m.tolist()}"[:200])
        trans_m = trans_m / per_m.item()
    far_m, height_m = np.abs(trans_m).max(), abs(float(np.median(trans_m[:, "xyz".index(up)])))
    if far_m > FARTHEST_M or height_m > HIGHEST_M:
        # The unit in which a body's root is as high above the floor as hips are.
        likely = [unit for unit, per_m in _UNITS.items() if 0.2 < height_m / per_m < 2.0]
        remedy = f"it seems to be in {likely[0]}" if likely else "convert it"
        raise unusable(
            path,
            f"whose {key!r} are {far_m:.3g} m off, {height_m:.3g} m high over half of the time",
            f"Expected are metres, {up} up, at most {FARTHEST_M:g} off and {HIGHEST_M:g} high: "
            f"{remedy}.",
        )
    return trans_m


def _rate(path: Path, arrays: Arrays, usual_fps: float, how: HowRead, notes: list[str]) -> float:
    """Frames a second; nan where the file does not say, or says two rates, or none at all where
    the user says it."""
    rates = []
    for key in (key for key in RATE_KEYS if key in arrays):
        stated, rate_hz = _one_rate(arrays[key])
        if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
            flaw = f"whose {key} is {stated}"[:200]
            if how.fps is None:
                raise unusable(path, flaw, "Write its rate, Hz, or pass --motion-fps.")
            notes.append(f"{path}, {flaw}, which is none, is read at {how.fps:g} frames a second")
            return how.fps
        rates.append(rate_hz)
    if not rates:
        return usual_fps
    return rates[0] if all(abs(one / rates[0] - 1) < _SAME_RATE for one in rates) else np.nan


def _one_rate(rate: NDArray) -> tuple[object, float]:
    """What is stated, and Hz; nan of what is no number."""
    rate = rate.reshape(()) if rate.size == 1 else rate
    stated = text_of(rate) if rate.dtype.kind in "US" and rate.size == 1 else rate.tolist()
    try:
        return stated, float(stated)
    except (TypeError, ValueError):  # of text, or of several
        return stated, np.nan


def _betas(path: Path, arrays: Arrays, notes: list[str]) -> NDArray[np.float64]:
    """(k,) coefficients, the median where each frame has its own."""
    key = first_of(arrays, BETAS_KEYS)
    if key is None:
        notes.append(f"{path} has no betas: the mean shape is taken")
        return np.zeros(N_BETAS)
    betas = finite(path, key, arrays[key])
    if betas.ndim == 2 and betas.shape[1] == 1:
        betas = betas[:, 0]
    if betas.ndim not in (1, 2) or not betas.size:
        flaw = f"whose {key!r} have shape {betas.shape}"
        raise unusable(path, flaw, f"Store one vector of {N_BETAS} or more coefficients.")
    betas = np.atleast_2d(betas)
    if (largest := np.abs(betas).max()) > LARGEST_BETA:
        raise unusable(path, f"whose {key!r} reach {largest:.3g}", "Store a person's, within 5.")
    if (far := np.ptp(betas[:, :N_BETAS], axis=0).max()) > _SAME_BETAS:
        notes.append(f"{path} changes its shape by up to {far:.2g} betas: the median is taken")
    return np.median(betas, axis=0)
