"""Motions that repeat, as AMASS files and as pose vectors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion import pack_theta
from tests.forged.amass import save, smplh


def circling(
    frames: int, lap: int = 40, *, turn_rad: float = 0.5, stride_m: float = 1.2
) -> NDArray[np.floating]:
    """(T, 69) somebody who walks a circle bouncing, y up; every `lap` frames she has gone
    `stride_m` along an arc and turned by `turn_rad`, and her pose is the same again."""
    phase = 2 * np.pi * np.arange(frames) / lap
    pose = np.zeros((frames, 22, 3))
    pose[:, [1, 2], 0] = 0.5 * np.stack([np.sin(phase), -np.sin(phase)], axis=1)
    pose[:, 16, 2], pose[:, 17, 2] = -1.2 + 0.2 * np.sin(2 * phase), 1.2 + 0.1 * np.sin(phase)
    heading = turn_rad * np.arange(frames) / lap
    lean = Rotation.from_rotvec(np.stack([0.1 + 0.05 * np.sin(phase), 0 * phase, 0 * phase], 1))
    about = Rotation.from_rotvec(np.stack([0 * phase, heading, 0 * phase], axis=1))
    pose[:, 0] = (about * lean).as_rotvec()
    radius_m = stride_m / turn_rad
    places = [
        radius_m * np.sin(heading),
        0.9 + 0.06 * np.sin(2 * phase),
        radius_m * np.cos(heading),
    ]
    return pack_theta(pose, np.stack(places, axis=1))


def save_on_the_spot(path: Path, frames: int, lap: int = 30) -> Path:
    """An AMASS file at 60 fps, z up, of somebody who bounces where she stands."""
    phase = 2 * np.pi * np.arange(frames) / lap
    poses, trans = np.zeros((frames, 156)), np.zeros((frames, 3))
    poses[:, 0] = np.pi / 2
    poses[:, 16 * 3 + 2] = -1.0 + 0.2 * np.sin(phase)
    trans[:, 2] = 0.9 + 0.03 * np.sin(phase)
    changes = {"poses": poses, "trans": trans, "source": "synthetic"}
    return save(path, smplh(frames, 60.0), **changes)
