"""Motions: the pose vector theta, files of motions, sequences, and who is trained on what."""

from bridge.motion.motion import Motion
from bridge.motion.resampling import load_motion
from bridge.motion.sequences import (
    MotionSequence,
    sequences_of,
    shape_rows,
    subject_rows,
    subject_shapes,
    subjects_of,
    to_manifest,
)
from bridge.motion.theta import pack_theta, unpack_theta

__all__ = [
    "Motion",
    "MotionSequence",
    "load_motion",
    "pack_theta",
    "sequences_of",
    "shape_rows",
    "subject_rows",
    "subject_shapes",
    "subjects_of",
    "to_manifest",
    "unpack_theta",
]
