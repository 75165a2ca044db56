"""What flesh feels: the loads of poses and their accelerations, against closed forms."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body.posing import Smpl, pose_vertices
from bridge.motion import pack_theta, unpack_theta
from bridge.paper import FPS
from bridge.tissue.oscillators import GRAVITY_M_S2, Load, node_loads

SKIN = np.arange(0, 6890, 40)
BETAS = np.linspace(-1.5, 1.5, 10)


def moving(frames: int = 40, seed: int = 0) -> np.ndarray:
    """(T, 69) joints and root that swing smoothly."""
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(0.05, 0.3, (1, 69)), rng.uniform(0, 2 * np.pi, (1, 69))
    return 0.3 * np.sin(rates * np.arange(frames)[:, None] + phases)


def held(root: Rotation, frames: int = 5) -> np.ndarray:
    """A body in the rest pose, turned as a whole."""
    pose = np.zeros((frames, 22, 3))
    pose[:, 0] = root.as_rotvec()
    return pack_theta(pose, np.zeros((frames, 3)))


def falling(acceleration: np.ndarray, frames: int = 9) -> np.ndarray:
    """The rest pose, whose root is accelerated."""
    seconds = np.arange(frames)[:, None] / FPS
    return pack_theta(np.zeros((frames, 22, 3)), 0.5 * seconds**2 * acceleration)


def loads(body, theta: np.ndarray) -> Load:
    return node_loads(body, SKIN, BETAS, theta, FPS)


def test_standing_as_scanned_is_no_load_at_all(body):
    load = loads(body, held(Rotation.identity()))
    assert len(load) == 5
    assert load.inertia.shape == load.gravity.shape == (5, len(SKIN), 3)
    assert not load.inertia.any()
    assert not load.gravity.any()


def test_free_fall_takes_away_the_weight_that_the_scan_had(body):
    load = loads(body, falling(GRAVITY_M_S2))
    felt = np.broadcast_to(-GRAVITY_M_S2, (7, len(SKIN), 3))
    np.testing.assert_allclose(load.inertia[1:-1], felt, atol=1e-4)
    assert not load.gravity.any()


def test_lying_on_the_back_pulls_up_the_rest_pose_and_backwards(body):
    """The body's own y stands up no more, and its back, -z, is below."""
    load = loads(body, held(Rotation.from_euler("x", -90, degrees=True)))
    felt = np.broadcast_to([0.0, 9.81, -9.81], load.gravity.shape)
    np.testing.assert_allclose(load.gravity, felt, atol=1e-5)


def test_acceleration_is_felt_backwards_in_the_bodys_frame(body):
    """Turned to the left by a right angle, the world's +x is the body's -z."""
    theta = falling(np.array([2.0, 0.0, 0.0]))
    theta[:, :3] = Rotation.from_euler("y", 90, degrees=True).as_rotvec()
    load = loads(body, theta)
    felt = np.broadcast_to([0.0, 0.0, -2.0], (7, len(SKIN), 3))
    np.testing.assert_allclose(load.inertia[1:-1], felt, atol=1e-4)
    np.testing.assert_allclose(load.gravity, 0.0, atol=1e-6)
    assert not load.inertia[[0, -1]].any()


def test_place_velocity_and_heading_of_the_motion_change_nothing(body):
    theta = moving()
    other = theta.copy()
    heading = Rotation.from_euler("y", 1.1)
    root = body.J_regressor @ (body.v_template + body.shapedirs @ BETAS)
    drift = np.array([3.0, 0.5, -2.0]) + 1.3 * np.arange(len(theta))[:, None] / FPS
    other[:, :3] = (heading * Rotation.from_rotvec(theta[:, :3])).as_rotvec()
    # The root's joint, not the world's origin, stays where it is when the root turns.
    other[:, -3:] = heading.apply(theta[:, -3:] + root[0]) - root[0] + drift
    one, two = loads(body, theta), loads(body, other)
    np.testing.assert_allclose(two.inertia, one.inertia, atol=1e-4)
    np.testing.assert_allclose(two.gravity, one.gravity, atol=1e-5)
    assert one.inertia.std() > 1.0


def test_skinning_is_the_body_models(body):
    theta = moving(300)[::100]
    places, turns = Smpl(body, SKIN, np.float64).person(BETAS).skin(*unpack_theta(theta))
    pose, trans = unpack_theta(theta)
    shape = np.tile(BETAS, (3, 1))
    whole = pose_vertices(body, shape, pose, trans)[:, SKIN]
    np.testing.assert_allclose(places, whole, atol=1e-12)
    # An offset in the rest pose is turned alike.
    offsets = np.zeros((3, 6890, 3))
    offsets[:, SKIN] = [0.01, 0.02, 0.03]
    moved = pose_vertices(body, shape, pose, trans, offsets)[:, SKIN] - whole
    np.testing.assert_allclose(turns @ [0.01, 0.02, 0.03], moved, atol=1e-12)


def test_motions_longer_than_what_is_skinned_at_once_have_no_seam(body):
    theta = moving(260)
    whole, tail = loads(body, theta), loads(body, theta[250:])
    np.testing.assert_allclose(whole.inertia[251:-1], tail.inertia[1:-1], atol=1e-5)
    np.testing.assert_allclose(whole.gravity[250:], tail.gravity, atol=1e-6)
