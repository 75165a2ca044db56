"""Every motion, on a lean and on a heavy body: floor, contact, flight, stillness, smoothness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.motion import unpack_theta
from bridge.motion.cuts import repeated_frames
from dsnet.synthetic.motions import HELD_OUT_MOTIONS, MOTIONS, WHOLE_S, Skeleton, perform
from dsnet.synthetic.motions.plan import Planner
from dsnet.synthetic.subjects import SUBJECTS, Gender
from torch_align_ae.body import SMPL
from torch_align_ae.body.smpl import world_frames

FPS, FRAMES, BALLS = 60.0, 200, (10, 11)
AIRBORNE = {
    "light_hopping_stiff",
    "light_hopping_loose",
    "one_leg_jump",
    "jumping_jacks",
    "running_on_spot",
    "side_to_side_hopping",
    "basketball_dribble_and_shoot",
}
every_motion = pytest.mark.parametrize("motion", MOTIONS)
lean_and_heavy = pytest.mark.parametrize("row", [0, 4])


@dataclass(frozen=True, eq=False)
class Performance:
    theta: np.ndarray
    pose: np.ndarray
    trans: np.ndarray
    lowest_m: np.ndarray
    """Of every fourth frame."""
    joints_m: np.ndarray
    contact: np.ndarray
    """(T, 2) whether each ball is on the floor, by plan."""


@cache
def body(gender):
    return SMPL(load_body_model(f"embedded:{gender}"))


@cache
def performance(motion, row, gender: Gender = "female"):
    smpl, subject = body(gender), SUBJECTS[gender][row]
    skeleton = Skeleton(smpl.data, subject.betas)
    count = max(FRAMES, round(WHOLE_S.get(motion, 0) * FPS))
    theta = perform(motion, subject.name, skeleton, frame_count=count, fps=FPS)
    times_s = np.arange(count) / FPS
    plan = MOTIONS[motion](Planner.drawn(subject.name, motion, times_s, skeleton.size, 0))
    balls_m = [np.broadcast_to(foot.ball_m, (count, 3)) for foot in plan.feet]
    contact = np.stack([ball_m[:, 1] < 1e-9 for ball_m in balls_m], axis=1)
    pose, trans = unpack_theta(theta)
    betas = torch.tensor(subject.betas).float().expand(count, -1)
    tensors = torch.tensor(pose).float(), torch.tensor(trans).float()
    with torch.no_grad():
        lowest = smpl(*(part[::4] for part in (betas, *tensors)))[..., 1].amin(1).numpy()
        rotations, joints = smpl.rotations(tensors[0]), smpl.joints(betas)
        places = world_frames(rotations, joints, smpl.parents, tensors[1])[1].numpy()
    return Performance(theta, pose, trans, lowest, places, contact)


@every_motion
@lean_and_heavy
def test_nothing_goes_through_the_floor_and_contact_is_on_it(motion, row):
    found = performance(motion, row)
    assert found.lowest_m.min() > -0.01
    standing = found.contact[::4].any(1)
    assert standing.mean() > 0.4
    assert found.lowest_m[standing].max() < 0.02


@every_motion
@lean_and_heavy
def test_a_foot_in_contact_does_not_slide(motion, row):
    found = performance(motion, row)
    for side, ball in enumerate(BALLS):
        stays = found.contact[1:, side] & found.contact[:-1, side]
        moved_m = np.linalg.norm(np.diff(found.joints_m[:, ball], axis=0), axis=1)
        assert moved_m[stays].max() < 1e-4


@every_motion
@lean_and_heavy
def test_flight_is_ballistic_and_only_jumps_have_one(motion, row):
    found = performance(motion, row)
    air = np.logical_not(found.contact.any(1))
    assert air.any() == (motion in AIRBORNE)
    inside = air[:-2] & air[1:-1] & air[2:]
    fall_m_s2 = np.diff(found.trans[:, 1], 2)[inside] * FPS**2
    np.testing.assert_allclose(fall_m_s2, -9.81, rtol=1e-6)


@every_motion
@lean_and_heavy
def test_it_starts_still_and_moves_without_jumps(motion, row):
    found = performance(motion, row)
    np.testing.assert_array_equal(found.theta[:5], found.theta[[0] * 5])
    assert np.abs(found.pose[100:] - found.pose[0]).max() > 0.1
    speed = np.linalg.norm(np.diff(found.pose, axis=0), axis=-1) * FPS
    assert speed.max() < 20
    assert not repeated_frames(found.theta, FPS).any()
    acceleration = np.linalg.norm(np.diff(found.pose, 2, axis=0), axis=-1) * FPS**2
    assert acceleration.max() < 1000
    assert np.abs(np.diff(found.trans, 2, axis=0)).max() * FPS**2 < 60


@every_motion
@lean_and_heavy
def test_knees_and_elbows_bend_the_human_way(motion, row):
    found = performance(motion, row)
    knees, elbows = found.pose[:, [4, 5]], found.pose[:, [18, 19]]
    assert knees[..., 0].min() > -0.15
    assert knees[..., 0].max() < 2.4
    assert (elbows[:, 0, 1] <= 0).all()
    assert (elbows[:, 1, 1] >= 0).all()
    assert np.abs(elbows[..., 1]).max() < 2.6


@every_motion
def test_frame_rate_and_length_only_sample_the_same_motion(motion):
    skeleton = Skeleton(body("female").data, SUBJECTS["female"][1].betas)
    at_60 = perform(motion, "50020", skeleton, frame_count=120, fps=60.0)
    at_120 = perform(motion, "50020", skeleton, frame_count=301, fps=120.0)
    np.testing.assert_allclose(at_120[:240:2], at_60, atol=1e-9)


def test_subjects_and_seeds_have_their_own_style():
    skeleton = Skeleton(body("female").data, SUBJECTS["female"][1].betas)

    def hop(subject, seed, take=1):
        options = {"frame_count": 120, "fps": 60.0, "seed": seed, "take": take}
        return perform("light_hopping_loose", subject, skeleton, **options)

    np.testing.assert_array_equal(hop("50020", 0), hop("50020", 0))
    assert np.abs(hop("50020", 0) - hop("50021", 0)).max() > 0.05
    assert np.abs(hop("50020", 0) - hop("50020", 1)).max() > 0.05
    assert np.abs(hop("50020", 0) - hop("50020", 0, 2)).max() > 0.05


@pytest.mark.parametrize("motion", HELD_OUT_MOTIONS)
def test_men_move_on_the_floor_too(motion):
    found = performance(motion, 0, "male")
    assert found.lowest_m.min() > -0.01
    assert np.linalg.norm(np.diff(found.pose, 2, axis=0), axis=-1).max() * FPS**2 < 1000


def test_walking_goes_ahead_with_one_foot_on_the_floor():
    found = performance("walking", 1)
    assert 1.5 < found.trans[-1, 2] - found.trans[0, 2] < 4.5
    assert found.contact.any(1).all()
    assert (np.diff(found.joints_m[60:, 0, 2]) > 0).all()


@lean_and_heavy
def test_turning_goes_round_by_more_than_half_a_turn(row):
    found = performance("turning", row)
    facing = Rotation.from_rotvec(found.pose[:, 0]).apply((0.0, 0.0, 1.0))
    heading = np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))
    assert abs(heading[-1] - heading[0]) > np.pi
    assert np.ptp(found.trans[:, [0, 2]], axis=0).max() < 0.3
    # Axis-angle vectors that go on beyond half a turn, as a reader makes them.
    assert np.linalg.norm(found.pose[:, 0], axis=1).max() > np.pi


@lean_and_heavy
def test_quick_stops_end_in_perfect_stillness(row):
    found = performance("quick_stops", row)
    still = (found.theta[1:] == found.theta[:-1]).all(1)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], still, [0]])))
    starts, lengths = ends[::2], np.diff(ends)[::2]
    assert max(lengths[starts > 12]) >= 0.7 * FPS
    stopping = np.abs(np.diff(found.trans[:, 2], 2)).max() * FPS**2
    assert stopping > 8


@lean_and_heavy
def test_lying_down_brings_the_trunk_down_and_up_again(row):
    found = performance("lying_down_and_getting_up", row)
    pelvis, chest, head = (found.joints_m[:, joint] for joint in (0, 9, 15))
    trunk = (chest - pelvis) / np.linalg.norm(chest - pelvis, axis=1, keepdims=True)
    lying = np.abs(trunk[:, 1]) < 0.15
    assert lying.sum() >= 0.5 * FPS
    front = Rotation.from_rotvec(found.pose[:, 0]).apply((0.0, 0.0, 1.0))
    assert (front[lying, 1] > 0.95).all()
    assert pelvis[lying, 1].max() < 0.2
    assert head[lying, 1].max() < 0.3
    assert trunk[-1, 1] > 0.95
    assert found.lowest_m.max() < 0.01


def test_sitting_down_brings_thighs_level_and_up_again():
    found = performance("sitting_down", 1)
    thigh = found.joints_m[:, 4] - found.joints_m[:, 1]
    slope = np.arcsin(-thigh[:, 1] / np.linalg.norm(thigh, axis=1))
    assert slope.min() < np.deg2rad(20)
    assert slope[:5].min() > np.deg2rad(70)


def test_bending_reaches_for_the_floor_and_then_up():
    found = performance("bending_and_reaching", 1)
    wrists_m, head_m = found.joints_m[:, 20:22, 1], found.joints_m[0, 15, 1]
    assert wrists_m.min() < 0.35
    assert wrists_m.max() > head_m + 0.2
