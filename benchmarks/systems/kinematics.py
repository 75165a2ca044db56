"""How a motion changes, as the systems that DSNet is compared with are told of it.

All derivatives are backward differences, so no later frame is looked at; where there is no past
yet (a velocity's first frame, an acceleration's first two) they are 0. Angular velocities are
logarithms of the turn from one frame to the next, which differences of axis-angle vectors are not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.posing import pose_features
from bridge.motion import unpack_theta
from bridge.paper import FPS, N_BETAS, N_JOINTS, THETA_SIZE

CHANGE_FRAMES = 6
"""Differences are scaled to what they amount to in 0.1 s at 60 fps, which brings them to the size
of poses: rad and m. One least spread then suits all inputs: a joint that hardly moved in training
is not magnified until a motion in which it does is beyond all bounds."""
CHANGE_S = CHANGE_FRAMES / 60
DIFFERENCES_SIZE = N_BETAS + 2 * THETA_SIZE
"""148: betas, and theta's first and second differences."""
ROOT_NUMBERS = 12
"""Velocity, acceleration, angular velocity and angular acceleration of the root."""
JOINT_NUMBERS = 6
"""Angular velocity and angular acceleration of each other joint."""
KINEMATICS_SIZE = ROOT_NUMBERS + JOINT_NUMBERS * (N_JOINTS - 1)
"""138: what `kinematics` gives of a frame."""
POSE_SIZE = 9 * (N_JOINTS - 1)
"""189: what `deviations_from_rest` gives of a frame."""


def kinematics(theta: NDArray, fps: float = FPS) -> NDArray[np.float64]:
    """What Dyna and Casas and Otaduy are told, (T, 138) of a motion theta (T, 69).

    The root's velocity (m/s), acceleration (m/s^2), angular velocity (rad/s) and angular
    acceleration (rad/s^2), seen in its own frame; then angular velocities of the 21 other joints
    relative to their parents (63), then their angular accelerations (63). None depends on where
    the body is or which way it faces.
    """
    turns, trans_m = _turns_and_places(theta)
    velocity = rates(trans_m, fps)
    acceleration = rates(velocity, fps, start=2)
    linear = np.stack([velocity, acceleration], axis=1) @ turns[:, 0]  # rows w^T R are R^T w
    angular = angular_velocities(turns, fps)
    angular_change = rates(angular, fps, start=2)
    frames = len(turns)
    parts = linear, angular[:, :1], angular_change[:, :1], angular[:, 1:], angular_change[:, 1:]
    return np.concatenate([part.reshape(frames, -1) for part in parts], axis=1)


def pose_differences(joined: NDArray) -> NDArray:
    """(T, 148) of betas and theta (T, 79): differences are 0 while there is no past."""
    betas, theta = joined[:, :N_BETAS], joined[:, N_BETAS:]
    first, second = np.zeros_like(theta), np.zeros_like(theta)
    first[1:] = np.diff(theta, axis=0)
    second[2:] = np.diff(theta, n=2, axis=0)
    return np.concatenate([betas, CHANGE_FRAMES * first, CHANGE_FRAMES**2 * second], axis=1)


def changes(theta: NDArray) -> NDArray[np.float64]:
    """`kinematics` (T, 138) as what each amounts to in 0.1 s, m and rad: what is learned from."""
    rates_and_changes_of_rates = np.array([CHANGE_S, CHANGE_S**2])
    others = JOINT_NUMBERS // 2 * (N_JOINTS - 1)
    factors = np.concatenate([
        np.repeat(np.tile(rates_and_changes_of_rates, 2), 3),
        np.repeat(rates_and_changes_of_rates, others),
    ])  # fmt: skip
    return kinematics(theta) * factors


def root_rates(theta: NDArray, fps: float = FPS) -> NDArray[np.float64]:
    """What SoftSMPL is told besides a code of the pose, (T, 12) of a motion theta (T, 69).

    The root's velocity (m/s) and acceleration (m/s^2) in the world's axes; the velocity (rad/s) and
    acceleration (rad/s^2) of its Euler angles, which are the same whichever way the motion faces.
    """
    turns, trans_m = _turns_and_places(theta)
    angles = np.unwrap(euler_zxy(turns[:, 0]), axis=0)
    parts = []
    for values in (trans_m, angles):
        velocity = rates(values, fps)
        parts += [velocity, rates(velocity, fps, start=2)]
    return np.concatenate(parts, axis=1)


def deviations_from_rest(theta: NDArray) -> NDArray[np.float64]:
    """(T, 189) entries of R - I of the joints below the root, of a motion theta (T, 69)."""
    return pose_features(_turns_and_places(theta)[0])


def rates(values: NDArray, fps: float, start: int = 1) -> NDArray[np.float64]:
    """Backward differences (T, ...) of values (T, ...), in their unit by the second.

    The first `start` frames are 0: a velocity has one frame without a past, its own rate two.
    """
    found = np.zeros(np.shape(values))
    found[start:] = np.diff(values, axis=0)[start - 1 :] * fps
    return found


def angular_velocities(turns: NDArray, fps: float) -> NDArray[np.float64]:
    """(T, J, 3) rad/s of rotations (T, J, 3, 3), in their own frames: log(R_{t-1}^T R_t) / dt."""
    steps = turns[:-1].swapaxes(-1, -2) @ turns[1:]
    found = np.zeros(turns.shape[:-1])
    if len(steps):
        logs = Rotation.from_matrix(steps.reshape(-1, 3, 3)).as_rotvec()
        found[1:] = logs.reshape(steps.shape[:-1]) * fps
    return found


def euler_zxy(turns: NDArray) -> NDArray[np.float64]:
    """(T, 3) angles z, x, y (rad) of R = R_y R_x R_z (T, 3, 3), scipy's order 'zxy'.

    A turn about y, which is up, adds to the last angle alone. Not scipy's, which warns where x is
    +-90 degrees and the other two turn about one axis.
    """
    x = np.arcsin(np.clip(-turns[:, 1, 2], -1.0, 1.0))
    z = np.arctan2(turns[:, 1, 0], turns[:, 1, 1])
    y = np.arctan2(turns[:, 0, 2], turns[:, 2, 2])
    return np.stack([z, x, y], axis=1)


def _turns_and_places(theta: NDArray) -> tuple[NDArray[np.float64], NDArray[np.floating]]:
    """Rotations (T, 22, 3, 3) of the joints to their parents and translations (T, 3), metres."""
    pose, trans_m = unpack_theta(np.asarray(theta, np.float64))
    turns = Rotation.from_rotvec(pose.reshape(-1, 3)).as_matrix()
    return turns.reshape(len(pose), N_JOINTS, 3, 3), trans_m
