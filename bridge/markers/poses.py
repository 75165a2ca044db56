"""Poses of files that were fitted to markers on flesh: told, and freed of the bounce they hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError, notify
from bridge.markers.bony import bones, bony_motion
from bridge.markers.marker_files import marker_file, read_markers
from bridge.markers.predicted import pose_of, register
from bridge.markers.segments import CUT_HZ, faster
from bridge.motion import Motion, pack_theta


def flesh_in_pose(motion: Motion) -> list[str]:
    """A line to warn of a file's pose that was fitted to flesh; none if it was not."""
    if marker_file(motion.source):
        by, remedy = "markers on skin", "--pose bony of predict, export and view takes it out"
    elif motion.dmpls is not None and motion.dmpls.any():
        by, remedy = "skin with dmpls", "without its markers it stays there"
    else:
        return []
    return [
        f"the pose of {motion.source} was fitted to {by} and holds part of the bounce, which "
        f"predicted flesh then counts twice: {remedy}"
    ]


def bony_pose(body: BodyModelData, motion: Motion) -> Motion:
    """A file's motion whose chest follows the file's markers on bone; says on stderr what that
    took out.

    `DsnetError` if there are no markers, or too few on bone, or they are not of this motion.

    Parameters
    ----------
    motion : as its file has it, y up.
    """
    path = marker_file(motion.source)
    if path is None:
        dmpls = motion.dmpls is not None and bool(motion.dmpls.any())
        raise DsnetError(
            f"--pose bony with {motion.source}, which has {'dmpls but ' * dmpls}no markers",
            "markers in it (marker_data), or a .c3d of the same name beside it"
            + ": what dmpls moved bones by cannot be told without DMPL's body" * dmpls,
            "Pass AMASS's SMPL-H file, or leave --pose out.",
        )
    own = motion.about_root_joint(shaped_joints(body, motion.betas[None])[0, 0])
    markers = read_markers(path, motion.source_fps, motion.duration_s)
    cloud = register(body, own, markers).cloud
    bony = bony_motion(body, own, cloud, pose_of(body, own))
    chest = SMPL_JOINT_NAMES.index("spine3")
    was, now = (bones(body, one)[:, chest, :3, 3] for one in (own, bony))
    bob_mm = 1e3 * np.ptp(faster(now - was, motion.fps)[:, 1])
    notify(
        f"--pose bony: the chest of {motion.source} follows its markers on bone, which takes "
        f"{bob_mm:.0f} mm of up and down above {CUT_HZ} Hz (peak to peak) out of its pose"
    )
    # Back to the file's root, of a body whose root joint rests at 0.
    return replace(
        motion, theta=pack_theta(bony.pose, bony.trans_m - (own.trans_m - motion.trans_m)[:1])
    )
