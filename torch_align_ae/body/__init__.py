"""The body model in PyTorch: posing (Eq. 1-2), unposing (Eq. 5), rotations."""

from bridge.body import load_body_model
from torch_align_ae.body.rotations import axis_angle_to_matrix
from torch_align_ae.body.smpl import SMPL, rest_pose_offsets, unpose

__all__ = ["SMPL", "axis_angle_to_matrix", "load_body_model", "rest_pose_offsets", "unpose"]
