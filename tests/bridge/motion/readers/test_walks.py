"""One walk in files of many makers is the same motion, or is refused or told with the right reason.

The files are others', in `$DSNET_TEST_CASES/walks`; kinds of our own making are in `test_kinds`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bridge import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import HowRead
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.skeletons import read_joint_map

WALKS = Path(os.environ.get("DSNET_TEST_CASES", "nowhere")) / "walks"
BVH, NPZ = "00_reference.bvh", "00_reference.npz"
MOST_DEG, MOST_M = 1.0, 0.01


class Walk(NamedTuple):
    file: str
    reference: str
    fps: float | None = None
    joint_map: str = ""
    person: int | None = None
    said: str = ""
    """What is told of it, or why it is refused."""
    farthest_m: float = MOST_M
    """Of the root, in a world with another origin."""


READ = (
    Walk("01_spine_26_ahead_silent.bvh", "01_reference_neck_back.bvh"),
    Walk("01b_spine_38_behind.bvh", BVH),
    Walk("01c_spine_24_behind_ok.bvh", BVH),
    Walk("02_frame_ids_missed.pkl", NPZ, 30.0, said="has no frames"),
    Walk("03_slahmr_pitched_silent.npz", NPZ, 30.0, said="floor_plane", farthest_m=np.inf),
    Walk("03b_slahmr_level.npz", NPZ, 30.0, said="floor_plane", farthest_m=np.inf),
    Walk("03c_slahmr_looks_down_30.npz", NPZ, 30.0, said="floor_plane", farthest_m=np.inf),
    Walk("04_hymotion_rh.npz", NPZ),
    Walk("05_frame_time_60.bvh", BVH, 60.0, said="'Frame Time' of 60"),
    Walk("05b_rate_0.npz", NPZ, 60.0, said="mocap_framerate"),
    Walk("06_smpl_names_a_pose_45.bvh", "06_reference_mixamo_names.bvh"),
    Walk("06b_smpl_names_a_pose_75.bvh", "06_reference_mixamo_names.bvh"),
    Walk("07_root_leaps_11cm.bvh", BVH, said="root at 1.25 s", farthest_m=0.12),
    Walk("08_own_names.bvh", BVH, joint_map="08_map_bom.txt"),
    Walk("09_prop_is_first_root.bvh", BVH, said="no person and left out"),
    Walk("10_prompthmr_results.pkl", NPZ, 30.0, said="2 people"),
    Walk("11_grab.npz", NPZ),
    Walk("12_phc_zlib_joblib.pkl", NPZ),
    Walk("14_omomo.npz", NPZ, 30.0),
    Walk("15_daz_genesis8.bvh", BVH),
    Walk("15_daz_genesis8.bvh", BVH, joint_map="15_daz_map.txt"),
    Walk("16_suffix_jnt.bvh", BVH),
    Walk("16b_suffix_joint.bvh", BVH),
    Walk("17_two_people.pkl", NPZ),
    Walk("17_two_people.pkl", NPZ, person=2, said="person 2", farthest_m=1.01),
    Walk("18_decimal_commas.bvh", BVH),
    Walk("19_wrapped_rows.bvh", BVH),
)
REFUSED = (
    Walk("12b_phalp_zlib_joblib.pkl", NPZ, 30.0, said="camera's space"),
    Walk("13_tram_hps_track_0.npy", NPZ, 30.0, said="camera's space"),
    Walk("14b_seamless.npz", NPZ, 30.0, said="space of a camera"),
    Walk("14c_pickled_tensors.pkl", NPZ, 30.0, said="tensors of PyTorch"),
)
pytestmark = pytest.mark.skipif(not WALKS.is_dir(), reason="no $DSNET_TEST_CASES/walks")


def opened(walk: Walk) -> Motion:
    joint_map = read_joint_map(WALKS / walk.joint_map) if walk.joint_map else {}
    how = HowRead(joint_map=joint_map, person=walk.person)
    return load_motion(WALKS / walk.file, walk.fps, how=how)


@pytest.mark.parametrize("walk", READ, ids=lambda walk: f"{walk.file}-{walk.joint_map}")
def test_it_is_the_walk(walk: Walk) -> None:
    motion, other = opened(walk), load_motion(WALKS / walk.reference)
    assert motion.theta.shape == other.theta.shape
    one, two = (Rotation.from_rotvec(m.pose.reshape(-1, 3)) for m in (motion, other))
    turns_deg = np.degrees((one.inv() * two).magnitude()).reshape(-1, 22)
    assert turns_deg.mean(axis=0).max() < MOST_DEG
    assert np.abs(motion.trans_m - other.trans_m).max() < walk.farthest_m
    assert walk.said in " ".join(motion_warnings(motion))


@pytest.mark.parametrize("walk", REFUSED, ids=lambda walk: walk.file)
def test_it_is_refused_for_what_it_is(walk: Walk) -> None:
    with pytest.raises(DsnetError, match=walk.said):
        opened(walk)
