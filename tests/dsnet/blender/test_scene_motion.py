"""An armature's motion is that of its joints, however a program lays its bones' frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge.errors import DsnetError
from bridge.motion import Motion
from tests.dsnet.blender.scenes import scene_armature


def test_a_motion_comes_back(walk: Motion) -> None:
    motion = scene_armature(walk).motion({})
    assert motion.fps == walk.fps
    turned = Rotation.from_rotvec(motion.pose.reshape(-1, 3)).inv()
    turned *= Rotation.from_rotvec(walk.pose.reshape(-1, 3))
    assert np.degrees(turned.magnitude()).max() < 1e-4
    moved_m = np.diff(motion.trans_m, axis=0) - np.diff(walk.trans_m, axis=0)
    assert np.abs(moved_m).max() < 2e-3  # legs are another person's


def test_bones_may_be_named_by_the_user(walk: Motion) -> None:
    armature = scene_armature(walk)
    named = replace(armature, bones=tuple("xabe"[n % 4] * (n + 1) for n in range(24)))
    with pytest.raises(DsnetError, match="no pelvis, left_hip"):
        named.motion({})
    joint_map = dict(zip(armature.bones[:22], named.bones, strict=False))
    # SMPL's own rest pose is known by its names: others' limbs are brought onto the bones.
    np.testing.assert_allclose(named.motion(joint_map).theta, armature.motion({}).theta, atol=0.02)


def test_one_frame_is_no_motion(walk: Motion) -> None:
    armature = scene_armature(walk)
    with pytest.raises(DsnetError, match="a scene of 1 frame"):
        replace(armature, world=armature.world[:1]).motion({})
