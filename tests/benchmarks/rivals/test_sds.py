"""The helper rig, and springs driven through the interface of the rival's code: a toy checkout."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from benchmarks.rivals.rig import carried_by_skeleton, helper_rig
from benchmarks.rivals.rival import MotionClip
from benchmarks.rivals.sds import Grid, SpringDecomposedSkinning
from benchmarks.rivals.springs import import_checkout
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import pose_vertices, shaped_vertices
from bridge.errors import DsnetError
from bridge.motion import unpack_theta

SKELETON = """
class Bone: pass
class Skeleton:
    def __init__(self): self.rest_bones = []
def create_skeleton(joints, tree):
    skeleton = Skeleton()
    skeleton.rest_bones = [Bone() for _ in joints]
    assert len(tree) == len(joints) - 1
    return skeleton
def add_helper_bones(skeleton, ends, parents):
    first = len(skeleton.rest_bones)
    for end, parent in zip(ends, parents):
        bone = Bone(); bone.end = end; skeleton.rest_bones.append(bone)
    return list(range(first, first + len(ends)))
"""
HANDLER = """
import numpy as np
class HelperBonesHandler:
    '''Each tip goes a part of the way to where it belongs: 8000 kg/s^2 all of it.'''
    def __init__(self, skeleton, idxs, stiffness, **others):
        self.idxs, self.part = idxs, stiffness / 8000
        self.at = np.array([skeleton.rest_bones[i].end for i in idxs])
        assert others["mass_dscale"] < 1, "springs fly"
    def update_bones(self, ends):
        ends = ends.copy()
        self.at = self.at + self.part * (ends[2 * self.idxs + 1] - self.at)
        ends[2 * self.idxs + 1] = self.at
        return ends
"""
GRID = Grid(helpers=(8, 12), powers=(1.0, 2.0), stiffness=(1000.0, 4000.0), damping=(0.0,),
            mass_dscale=(0.5, 1.0), compliance=(None,))  # fmt: skip


@pytest.fixture
def checkout(tmp_path):
    folder = tmp_path / "checkout"
    (folder / "src").mkdir(parents=True)
    sources = {"skeleton": SKELETON, "helper_handler": HANDLER, "mass_spring": "import pyvista"}
    for name, text in sources.items():
        (folder / "src" / f"{name}.py").write_text(text)
    return folder


def motion(frames=20):
    """(theta, fps): a body that turns and rises, all joints bent a little."""
    times = np.arange(frames) / 60
    theta = np.zeros((frames, 69), np.float32)
    theta[:, :66] = 0.1 * np.random.default_rng(1).normal(size=66)
    theta[:, 1], theta[:, 67] = 2 * times, 0.3 * np.sin(6 * times)
    return theta, 60.0


def test_helpers_lie_on_flesh_and_share_the_skin(body):
    rig = helper_rig(body, 16)
    names = {SMPL_JOINT_NAMES[parent].rpartition("_")[2] for parent in rig.parents}
    assert len(set(rig.tips)) == 16
    assert not names & {"head", "ankle", "foot", "wrist", "hand"}
    np.testing.assert_allclose(rig.shares.sum(axis=1), 1, rtol=1e-12)
    assert (rig.shares[rig.tips].argmax(axis=1) == np.arange(16)).all()
    assert (rig.weights(1.0) >= 0).all()
    hand = body.weights.argmax(axis=1) == SMPL_JOINT_NAMES.index("left_hand")
    assert not rig.weights(2.0)[hand].any()


def test_tips_go_with_one_bone(body):
    rig, (theta, _) = helper_rig(body, 12), motion(3)
    betas = 0.5 * np.ones(10)
    joints, tips = carried_by_skeleton(rig, body, betas, np.zeros((1, 69)))
    np.testing.assert_allclose(tips[0], shaped_vertices(body, betas[None])[0, rig.tips])
    assert joints.shape == (1, 24, 3)
    # Where the skin has one bone and no pose blend shapes, it is there too.
    theta[:, 3:66] = 0
    pose, trans = unpack_theta(theta.astype(float))
    skin = pose_vertices(body, np.repeat(betas[None], 3, 0), pose, trans)[:, rig.tips]
    np.testing.assert_allclose(carried_by_skeleton(rig, body, betas, theta)[1], skin, atol=1e-9)


def test_settings_that_made_the_offsets_are_found_again(body, checkout):
    theta, fps = motion()
    betas, shape = np.zeros(10), (len(theta), len(body.v_template), 3)
    below = np.broadcast_to(np.array([0, -1e-2, 0], np.float32), shape)
    maker = SpringDecomposedSkinning(checkout, body, Grid(
        helpers=(12,), powers=(2.0,), stiffness=(4000.0,), damping=(0.0,), mass_dscale=(0.5,),
        compliance=(None,),
    ))  # fmt: skip
    maker.choose([MotionClip(betas, theta, fps, below)])
    made = maker.offsets_m(betas, theta, fps)
    assert np.abs(made).max() > 1e-6
    rival = SpringDecomposedSkinning(checkout, body, GRID)
    clauses = rival.choose([MotionClip(betas, theta, fps, made)])
    assert "12 helpers" in clauses[1]
    assert "power 2" in clauses[1]
    assert "stiffness 4000" in clauses[2]
    assert "R² 1.00" in clauses[2]
    np.testing.assert_allclose(rival.offsets_m(betas, theta, fps), made, atol=1e-7)


def test_offsets_are_what_the_springs_add_in_the_rest_pose(body, checkout):
    theta, fps = motion()
    still = np.repeat(theta[:1], 5, axis=0)
    betas, shape = np.zeros(10), (len(theta), len(body.v_template), 3)
    rival = SpringDecomposedSkinning(checkout, body, GRID)
    below = np.broadcast_to(np.array([0, -1e-2, 0], np.float32), shape)
    rival.choose([MotionClip(betas, theta, fps, below)])
    # From motion to motion springs start at rest, and a body at rest stays as it is.
    np.testing.assert_array_equal(rival.offsets_m(betas, still, fps), 0)
    # Body and path turned by half a turn about the vertical, the rest pose's offsets are the same.
    straight = theta.copy()
    straight[:, :3], straight[:, 66] = 0, theta[:, 67]
    once = rival.offsets_m(betas, straight, fps)
    assert np.abs(once[..., 0]).max() > 1e-4
    turned = straight.copy()
    turned[:, 1], turned[:, 66] = np.pi, -straight[:, 66]
    np.testing.assert_allclose(rival.offsets_m(betas, turned, fps), once, atol=1e-7)


def test_an_unfit_checkout_is_one_line(checkout):
    _, handler = import_checkout(checkout)
    assert handler.HelperBonesHandler
    assert not [name for name in sys.modules if name.partition(".")[0] == "src"]
    (checkout / "src" / "helper_handler.py").write_text("import no_such_module")
    with pytest.raises(DsnetError, match=r"which does not import .*no_such_module"):
        import_checkout(checkout)
    (checkout / "src" / "mass_spring.py").unlink()
    with pytest.raises(DsnetError, match=r"without src/mass_spring\.py; expected a checkout of"):
        import_checkout(checkout)
