"""Synthetic people who wear markers: flesh of known constants under motions, and AMASS files of it.

A pose that was fitted to soft markers too holds part of what they do: `swallowed` gives a pose the
part that AMASS's pose of a jumping woman has of her bounce (two thirds of it, by way of a root that
bobs and a spine that pitches).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.prediction.marker_pose import EMBEDDED_MARKERS
from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import Smpl, shaped_joints
from bridge.motion import pack_theta, unpack_theta
from bridge.motion.motion import Y_UP_FROM_Z_UP
from bridge.runs.run import TRAIN_PLUS
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.fitting.tissue_patch import Region, logit, with_changes
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel, codes_of

VERTICES = EMBEDDED_MARKERS | {"LELB": 4814, "RELB": 1391}
"""Of the embedded bodies, where optical markers sit."""
_NOISE_M, _GAPS, _GAP_FRAMES = 0.0005, 0.03, 5
_BOB, _PITCH, _LEVER_M = 0.38, 0.30, 0.2


@dataclass(frozen=True)
class Flesh:
    """Of one region, standing."""

    frequency_hz: float
    damping_ratio: float
    preload: float


def packaged(gender: str) -> TrainedPlus:
    """The model that comes with the package."""
    return TrainedPlus.load(load_model(None, None, gender).artifacts[TRAIN_PLUS])


def flesh_model(body: BodyModelData, model: TrainedPlus, flesh: Mapping[str, Flesh]) -> TrainedPlus:
    """A model whose regions have these constants on the template."""
    regions = {part: Region.of(body, model, part) for part in flesh}
    base = {name: log[:, 0].astype(np.float64) for name, log in model.weights.base.items()}
    changes = {
        part: [
            (np.log(2 * np.pi * one.frequency_hz) - region.typical @ base["omega"]) / region.reach,
            (np.log(one.damping_ratio) - region.typical @ base["damping_ratio"]) / region.reach,
            float(logit(one.preload)),
        ]
        for part, one in flesh.items()
        for region in [regions[part]]
    }
    return with_changes(body, model, regions, changes)


def write_recording(
    path: Path,
    model: PlusModel,
    body: BodyModelData,
    betas: NDArray,
    theta: NDArray,
    rng: np.random.Generator,
    swallows: bool = False,
) -> float:
    """An AMASS file of theta (T, 69), y up at 60 fps, with markers on moving flesh, half a
    millimetre of noise and gaps; gives how far the bust moves up and down, metres."""
    labels, vertices = zip(*VERTICES.items(), strict=True)
    codes = np.stack([*codes_of(model, theta.astype(np.float32), betas)])
    offsets_m = np.einsum("tyk,vk->tvy", codes, model.trained.nodes.reading(np.array(vertices)))
    person = Smpl(body, np.array(vertices), np.float64).person(betas)
    points = np.asarray(person.pose(*unpack_theta(theta), offsets_m))
    points += _NOISE_M * rng.standard_normal(points.shape)
    for marker in range(len(labels)):
        for first in np.flatnonzero(rng.random(len(points)) < _GAPS / _GAP_FRAMES):
            points[first : first + _GAP_FRAMES, marker] = np.nan
    bust = [labels.index(label) for label in ("LBUST", "RBUSTLO")]
    bounce_m = offsets_m[:, bust, 1].mean(axis=1)
    pose, trans = unpack_theta(swallowed(theta, bounce_m - bounce_m.mean()) if swallows else theta)
    z_up, joint_m = Y_UP_FROM_Z_UP.inv(), shaped_joints(body, betas[None])[0, 0]
    poses = np.zeros((len(pose), 156))
    poses[:, :66] = pose.reshape(len(pose), -1)
    poses[:, :3] = (z_up * Rotation.from_rotvec(pose[:, 0])).as_rotvec()
    np.savez(
        path,
        poses=poses,
        trans=z_up.apply(trans + joint_m) - joint_m,
        betas=np.r_[betas, np.zeros(6)],
        gender=np.array(body.gender),
        mocap_framerate=np.array(60.0),
        source=np.array("synthetic"),
        marker_data=z_up.apply(points.reshape(-1, 3)).reshape(points.shape),
        marker_labels=np.array(labels),
    )
    return float(np.ptp(bounce_m))


def swallowed(theta: NDArray, bounce_m: NDArray) -> NDArray[np.floating]:
    """A pose that has taken on part of a bounce (T,)."""
    pose, trans = (np.array(part, np.float64) for part in unpack_theta(theta))
    trans[:, 1] += _BOB * bounce_m
    angle = _PITCH * bounce_m / _LEVER_M
    for joint, part, first in (
        ("spine2", -0.6, False),
        ("spine3", -0.4, False),
        ("neck", 1.0, True),
    ):
        column = SMPL_JOINT_NAMES.index(joint)
        turn = Rotation.from_rotvec(np.outer(part * angle, [1.0, 0.0, 0.0]))
        before = Rotation.from_rotvec(pose[:, column])
        pose[:, column] = (turn * before if first else before * turn).as_rotvec()
    return pack_theta(pose, trans)
