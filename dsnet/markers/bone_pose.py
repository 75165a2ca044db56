"""A pose that follows markers on bone where the file's pose follows flesh.

A pose that was fitted to all markers, as MoSh's of AMASS, holds part of what flesh does: chest,
head and pelvis bob with it, and flesh that is predicted on such a pose counts its bounce twice
(Figure 10). Here the spine turns as markers on the bone of the chest turn, neck and arms keep their
direction in the world, and the body is shifted so that the chest is where those markers are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import joint_rotations, shaped_joints
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, pack_theta, unpack_theta
from bridge.motion.readers.recordings import is_recording
from dsnet.markers.marker_files import markers_of
from dsnet.markers.registration import register
from dsnet.markers.segments import CUT_HZ, SEGMENTS, Cloud, Pose, faster, segment_frames

_NOISE_HZ = 15.0
"""What is faster in the frame of the chest is noise of its markers."""
_SPINE = ("spine1", "spine2", "spine3")
_ON_THE_CHEST = ("neck", "left_collar", "right_collar")


def flesh_in_pose(motion: Motion) -> list[str]:
    """A line to warn of a file's pose that was fitted to flesh; none if it was not."""
    if motion.markers is not None and is_recording(motion.source):
        return []  # to those on bone alone
    if motion.markers is not None:
        by, remedy = "markers on skin", "--pose bony of predict, export and view takes it out"
    elif motion.dmpls is not None and motion.dmpls.any():
        by, remedy = "skin with dmpls", "without its markers it stays there"
    else:
        return []
    return [
        f"the pose of {motion.source} was fitted to {by} and holds part of the bounce, which "
        f"predicted flesh then counts twice: {remedy}"
    ]


def bone_pose_of(body: BodyModelData, motion: Motion) -> Motion:
    """A file's motion whose chest follows the file's markers on bone; says on stderr what that
    took out.

    `DsnetError` if there are no markers, or too few on bone, or they are not of this motion.

    Parameters
    ----------
    motion : as its file has it, y up.
    """
    if motion.markers is None:
        dmpls = motion.dmpls is not None and bool(motion.dmpls.any())
        raise DsnetError(
            f"--pose bony with {motion.source}, which has {'dmpls but ' * dmpls}no markers",
            "markers in it (marker_data), or a .c3d of the same name beside it"
            + ": what dmpls moved bones by is unknown without DMPL's body" * dmpls,
            "Pass AMASS's SMPL-H file, or leave --pose out.",
        )
    placed = motion.about_root_joint(shaped_joints(body, motion.betas[None])[0, 0])
    cloud = register(body, placed, markers_of(motion)).cloud
    on_bone = bone_motion(body, placed, cloud)
    chest = SMPL_JOINT_NAMES.index("spine3")
    was, now = (Pose.of(body, one).bones[:, chest, :3, 3] for one in (placed, on_bone))
    bob_mm = 1e3 * np.ptp(faster(now - was, motion.fps)[:, 1])
    notify(
        f"--pose bony: the chest of {motion.source} follows its markers on bone, which takes "
        f"{bob_mm:.0f} mm of up and down above {CUT_HZ} Hz (peak to peak) out of its pose"
    )
    # Back to the file's root, of a body whose root joint rests at 0.
    root_m = (placed.trans_m - motion.trans_m)[:1]
    return replace(motion, theta=pack_theta(on_bone.pose, on_bone.trans_m - root_m))


def bone_motion(body: BodyModelData, motion: Motion, cloud: Cloud) -> Motion:
    """The motion whose chest is where markers on its bone are.

    `DsnetError` if fewer than three markers on the bone of the chest were seen, or if the
    motion has cuts.

    Parameters
    ----------
    cloud : markers, in the body's world.
    """
    if motion.cuts:
        raise DsnetError(
            f"{motion.source}, which jumps at {motion.cuts[0] / motion.fps:.2f} s",
            "a motion without cuts, over which its markers are smoothed",
            "Divide the file there, or use the pose of the file.",
        )
    pose = Pose.of(body, motion)
    frame = segment_frames(cloud, pose).get("thorax")
    if frame is None:
        raise DsnetError(
            f"{motion.source}, without three markers on the bone of the chest",
            f"some of {', '.join(SEGMENTS['thorax'].labels)}",
            "Use the pose of the file.",
        )
    index = SMPL_JOINT_NAMES.index
    rotvecs, trans = (np.array(part) for part in unpack_theta(motion.theta))
    local = joint_rotations(body, rotvecs)
    world = pose.turns
    chest = Rotation.from_matrix(_slow(frame.turns, motion.fps)).as_matrix()

    # What the chest turns beyond the mean spine is shared by its three joints.
    spine = [index(name) for name in _SPINE]
    means = [Rotation.from_matrix(local[:, joint]).mean().as_matrix() for joint in spine]
    wanted = world[:, 0].transpose(0, 2, 1) @ chest
    beyond = Rotation.from_matrix(wanted @ (means[0] @ means[1] @ means[2]).T)
    third = Rotation.from_rotvec(beyond.as_rotvec() / 3).as_matrix()
    below = world[:, 0]
    for joint, mean in zip(spine[:2], means[:2], strict=True):
        local[:, joint] = third @ mean
        below = below @ local[:, joint]
    local[:, spine[2]] = below.transpose(0, 2, 1) @ chest
    for child in map(index, _ON_THE_CHEST):
        local[:, child] = chest.transpose(0, 2, 1) @ world[:, child]

    changed = [*spine, *map(index, _ON_THE_CHEST)]
    turned = Rotation.from_matrix(local[:, changed].reshape(-1, 3, 3)).as_rotvec()
    rotvecs[:, changed] = turned.reshape(len(local), -1, 3)
    moved = replace(motion, theta=pack_theta(rotvecs, trans))
    return replace(moved, theta=pack_theta(rotvecs, trans + _shift(body, moved, frame.places_m)))


def _shift(body: BodyModelData, motion: Motion, places_m: NDArray) -> NDArray[np.float64]:
    """(T, 3) by which the body lies beside the chest's markers, which keep their place in it."""
    chest = Pose.of(body, motion).bones[:, SMPL_JOINT_NAMES.index("spine3")]
    turns, origin = chest[:, :3, :3], chest[:, :3, 3]
    places = _slow(places_m, motion.fps)
    inside = np.einsum("tyx,ty->tx", turns, places - origin).mean(axis=0)
    return places - (turns @ inside + origin)


def _slow(series: NDArray, fps: float) -> NDArray[np.float64]:
    """What is slower than noise, of (T, ...)."""
    if fps <= 2 * _NOISE_HZ:
        return np.asarray(series, np.float64)
    # Every prediction imports this module, and few have markers: SciPy's filters load slowly.
    from scipy.signal import butter, sosfiltfilt

    low = butter(2, _NOISE_HZ, fs=fps, output="sos")
    return np.asarray(sosfiltfilt(low, series, axis=0), np.float64)
