"""A motion's height above the floor, when another body than its own performs it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.body.smpl import Smpl
from bridge.errors import DsnetError
from bridge.motion import Motion, pack_theta, unpack_theta

Floor = Literal["keep", "shift", "scale"]
_SOLE_PERCENTILE = 1.0
"""Of the lowest points of all frames: a single bad frame does not lift the motion."""
_LEGS = ("left_hip", "right_hip")
_FEET = ("left_ankle", "right_ankle", "left_foot", "right_foot")
_EVERY = 8
"""Vertices of the rest of the body, of which fewer are looked at than of the feet."""


def put_on_floor(motion: Motion, body: BodyModelData, floor: Floor, own: Motion) -> Motion:
    """A motion whose lowest point stands on the floor, at height 0.

    Parameters
    ----------
    motion : y up, about the root joint of the body that performs it.
    body : the model of that body.
    floor : `keep` changes nothing; `shift` adds one number to all heights, so that jumps take the
        time they take; `scale` first multiplies the root's travel and height by the ratio of leg
        lengths, so that strides fit.
    own : the same motion of the body whose it is, about its root joint: for `scale`.

    Raises
    ------
    DsnetError
        If the file's betas are not of a body with legs.
    """
    if floor == "keep":
        return motion
    if floor == "scale":
        motion = _strides_fitted(motion, body, own)
    low_m = np.percentile(lowest_points_m(motion, body), _SOLE_PERCENTILE)
    pose, trans_m = unpack_theta(motion.theta)
    return replace(motion, theta=pack_theta(pose, trans_m - [0.0, low_m, 0.0]))


def lowest_points_m(motion: Motion, body: BodyModelData) -> NDArray[np.float64]:
    """(T,) height of the body's lowest point in each frame, without skin offsets."""
    feet = body.weights[:, [SMPL_JOINT_NAMES.index(name) for name in _FEET]].sum(axis=1) > 0.5
    looked_at = feet | (np.arange(len(feet)) % _EVERY == 0)
    person = Smpl(body, np.flatnonzero(looked_at), np.float64).person(motion.betas)
    places_m = person.pose(*unpack_theta(np.asarray(motion.theta, np.float64)))
    return places_m[..., 1].min(axis=1)


def leg_length_m(body: BodyModelData, betas: NDArray) -> float:
    """From the hips' joints to the soles, of a body of shape betas (10,) at rest."""
    betas = np.asarray(betas, np.float64)[None]
    hips = shaped_joints(body, betas)[0, [SMPL_JOINT_NAMES.index(name) for name in _LEGS], 1]
    return float(hips.mean() - shaped_vertices(body, betas)[0, :, 1].min())


def _strides_fitted(motion: Motion, body: BodyModelData, own: Motion) -> Motion:
    own_m = leg_length_m(body, own.betas)
    if not 0.1 < own_m < 10.0:
        raise DsnetError(
            f"--floor scale with {motion.source}, whose betas are of legs of {own_m:.3g} m",
            "a person's",
            "Pass --floor shift.",
        )
    ratio = leg_length_m(body, motion.betas) / own_m
    _, own_trans_m = unpack_theta(own.theta)
    places_m = own_trans_m + root_joint_m(body, own.betas)
    start_m = places_m[:1] * [1.0, 0.0, 1.0]
    trans_m = start_m + ratio * (places_m - start_m) - root_joint_m(body, motion.betas)
    pose, _ = unpack_theta(motion.theta)
    return replace(motion, theta=pack_theta(pose, trans_m))


def root_joint_m(body: BodyModelData, betas: NDArray) -> NDArray[np.float64]:
    """(3,) where the root joint of a body of shape betas (10,) rests."""
    return shaped_joints(body, np.asarray(betas, np.float64)[None])[0, 0]
