"""Motion files of every kind that people have, forged: one walk, on one skeleton, written by turns.

`python -m tests.forged.motion_kinds` reads them all and writes docs/results/motion_kinds.md.
"""

from __future__ import annotations

import contextlib
import io
import pickle
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion
from bridge.motion.motion import AS_IT_SAYS, HowRead
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.skeletons import OWN_NAMES
from tests.forged import scenes
from tests.forged.foreign_pickles import by_joblib, by_torch
from tests.forged.walks import (
    FRAMES,
    HANGING,
    MIXAMO,
    RAISED,
    TOES_DOWN,
    about,
    along_x,
    bvh,
    by_frames,
    edited,
    flipped,
    in_radians,
    joints_m,
    matrices,
    named,
    of_camera,
    person,
    prop_first,
    root_reordered,
    smpl,
    trunk_cm,
    turned,
    twisted,
    two_people,
    undone_hips,
    walk,
    wrapped,
    y_up,
)

PAGE = Path(__file__).parents[2] / "docs" / "results" / "motion_kinds.md"
BEGIN, END = "<!-- kinds -->\n", "<!-- end of kinds -->"
MOST_DEG, MOST_M = 1.0, 0.01


@dataclass(frozen=True)
class Kind:
    """A file, and what is to come of it."""

    file: str
    what: str
    content: Callable[[], str | bytes | dict[str, Any] | np.ndarray]
    fps: float | None = None
    how: HowRead = AS_IT_SAYS
    differs: str = ""
    """What is not as the reference, and told."""

    def write(self, folder: Path) -> Path:
        """The file."""
        path, content = folder / self.file, self.content()
        if isinstance(content, dict):
            with path.open("wb") as file:
                np.savez(file, **content)
        elif isinstance(content, np.ndarray):
            np.save(path, content)
        else:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def read(self, folder: Path) -> tuple[Motion, list[str]]:
        """The motion, and what is told of it."""
        with contextlib.redirect_stderr(io.StringIO()):
            motion = load_motion(self.write(folder), self.fps, how=self.how)
        return motion, motion_warnings(motion)


_UNREAL = named("pelvis,spine_01,spine_02,spine_03,neck_01,head",
                "thigh,calf,foot,ball,clavicle,upperarm,lowerarm,hand", "{name}_{s}")  # fmt: skip
_BIPED = [f"Bip001 {name}" for name in named(
    "Pelvis,Spine,Spine1,Spine2,Neck,Head",
    "Thigh,Calf,Foot,Toe0,Clavicle,UpperArm,Forearm,Hand", "{S} {name}",
)]  # fmt: skip
_MOCOPI = named("root,torso_1,torso_4,torso_7,neck_1,head",
                "up_leg,low_leg,foot,toes,shoulder,up_arm,low_arm,hand", "{s}_{name}")  # fmt: skip
_KINECT = named("SpineBase,Spine1,SpineMid,SpineShoulder,Neck,Head",
                "Hip,Knee,Ankle,Foot,Clavicle,Shoulder,Elbow,Wrist", "{name}{side}")  # fmt: skip
_OPTITRACK = named("Hip,Ab,Spine3,Chest,Neck,Head",
                   "Thigh,Shin,Foot,Toe,Shoulder,UArm,FArm,Hand", "{S}{name}")  # fmt: skip
_VRM = [f"J_Bip_{name}" for name in named(
    "C_Hips,C_Spine,C_Chest,C_UpperChest,C_Neck,C_Head",
    "UpperLeg,LowerLeg,Foot,ToeBase,Shoulder,UpperArm,LowerArm,Hand", "{S}_{name}",
)]  # fmt: skip
_SOMA = named("Hips,Spine1,Spine2,Chest,Neck1,Head",
              "Leg,Shin,Foot,ToeBase,Shoulder,Arm,ForeArm,Hand", "{side}{name}")  # fmt: skip
_ACCLAIM = named("root,lowerback,upperback,thorax,lowerneck,head",
                 "femur,tibia,foot,toes,clavicle,humerus,radius,wrist", "{s}{name}")  # fmt: skip
_RIGIFY = named("hips,spine,chest,upper_chest,neck,head",
                "thigh,shin,foot,toe,shoulder,upper_arm,forearm,hand", "{name}.{S}")  # fmt: skip
_BODY = {"global_orient": y_up()[:, :3], "body_pose": y_up()[:, 3:66], "transl": walk()[1]}
_FRAME = {"3d_joints": [], "camera": [], "smpl": [{"global_orient": np.eye(3)[None]}]}
_NUMBERED = [f"bone{number}" for number in range(24)]

KINDS = (
    Kind("walk.bvh", "Mixamo's names, a T at rest", bvh),
    Kind("collars.bvh", "collars and arms raised at rest", lambda: bvh(frames=RAISED)),
    Kind("along_x.bvh", "all bones along x, as LAFAN1's",
         lambda: bvh(frames=along_x(legs=180, arms=90)),
         differs="feet"),
    Kind("toes_down.bvh", "toes down at rest", lambda: bvh(frames=TOES_DOWN), differs="feet"),
    Kind("trunk.bvh", "the trunk begins 38 degrees behind the hips",
         lambda: bvh(rest_cm=trunk_cm(-38))),
    Kind("smpl_a.bvh", "SMPL's names, an A at rest",
         lambda: bvh(SMPL_JOINT_NAMES, frames=HANGING)),
    Kind("turned.bvh", "rest pose turned by 45 degrees", lambda: bvh(frames=turned(45))),
    Kind("z_world.bvh", "rests with y up, world with z up", lambda: bvh(world=about("x", 90))),
    Kind("upside_down.bvh", "rests with y up, world with -y up",
         lambda: bvh(world=about("z", 180))),
    Kind("left_handed.bvh", "left-handed", lambda: bvh(mirror=True)),
    Kind("undone.bvh", "joints of no length undo the hips' turn", undone_hips),
    *(
        Kind(f"{name}.bvh", f"a joint flips for some frames: {name}", partial(flipped, name))
        for name in ("LeftToeBase", "RightHand", "Head", "Spine1", "RightLeg")
    ),
    Kind("unreal.bvh", "names of Unreal", lambda: bvh(_UNREAL)),
    Kind("biped.bvh", "names of Biped, with blanks", lambda: bvh(_BIPED)),
    Kind("model.bvh", "prefix `Model_`", lambda: bvh([f"Model_{name}" for name in MIXAMO])),
    Kind("character.bvh", "prefix `Character1_`",
         lambda: bvh([f"Character1_{name}" for name in MIXAMO])),
    Kind("spaces.bvh", "namespaces", lambda: bvh([f"A:Solving:{name}" for name in MIXAMO])),
    Kind("mocopi.bvh", "names of mocopi", lambda: bvh(_MOCOPI)),
    Kind("kinect.bvh", "names of Kinect", lambda: bvh(_KINECT)),
    Kind("optitrack.bvh", "names of OptiTrack", lambda: bvh(_OPTITRACK)),
    Kind("vrm.bvh", "names of VRM", lambda: bvh(_VRM)),
    Kind("soma.bvh", "names of SOMA", lambda: bvh(_SOMA)),
    Kind("acclaim.bvh", "names of Acclaim", lambda: bvh(_ACCLAIM)),
    Kind("rigify.bvh", "names of Rigify", lambda: bvh(_RIGIFY)),
    Kind("endings.bvh", "endings `_JNT`",
         lambda: bvh([f"{name}_JNT" for name in _RIGIFY])),
    Kind("twists.bvh", "names and twist bones of Daz's Genesis 3 and 8", twisted),
    Kind("map.bvh", "other names, and `--joint-map`", lambda: bvh(_NUMBERED),
         how=HowRead(joint_map=dict(zip(OWN_NAMES, _NUMBERED, strict=False)))),
    Kind("numbered.bvh", "other names", lambda: bvh(_NUMBERED)),
    Kind("root_zyx.bvh", "the root's positions in another order", root_reordered),
    Kind("latin.bvh", "latin-1", lambda: edited((r"JOINT RightHandEnd", "JOINT Höcker"))
         .encode("latin-1")),
    Kind("CAPITALS.BVH", "name in capitals", bvh),
    Kind("more.bvh", "one frame more declared", lambda: edited((r"^Frames: 90", "Frames: 91"))),
    Kind("two.bvh", "two people", two_people),
    Kind("prop.bvh", "a prop before the person", prop_first),
    Kind("commas.bvh", "decimal commas", lambda: bvh().replace(".", ",")),
    Kind("wrapped.bvh", "frames wrapped onto several lines", wrapped),
    Kind("seconds.bvh", "`Frame Time: 60`", lambda: edited((r"^Frame Time.*", "Frame Time: 60"))),
    Kind("given_seconds.bvh", "the same, and `--motion-fps`",
         lambda: edited((r"^Frame Time.*", "Frame Time: 60")), 60.0),
    Kind("no_blank.bvh", "`Frame Time:x`", lambda: edited((r"^(Frame.*): ", r"\1:"))),
    Kind("radians.bvh", "angles in radians", in_radians, differs="limbs"),
    Kind("nan.bvh", "numbers that are none", lambda: edited((r"\A(.*\n)+.*\s\S+$", r"\g<0> nan"))),
    Kind("walk.npz", "AMASS, SMPL-H", smpl),
    Kind("y_up.npz", "y up with AMASS's keys (BEAT2, GVHMR)",
         lambda: smpl(poses=y_up(165), trans=walk()[1])),
    Kind("66.npz", "66 numbers a frame", lambda: smpl(poses=smpl()["poses"][:, :66])),
    Kind("24x3.npz", "(T, 24, 3)", lambda: smpl(poses=smpl()["poses"][:, :72].reshape(-1, 24, 3))),
    Kind("matrices.npz", "(T, 22, 3, 3)",
         lambda: smpl(poses=matrices(smpl()["poses"][:, :66].reshape(-1, 22, 3)))),
    Kind("132.npz", "132: two lines of each matrix",
         lambda: smpl(poses=matrices(smpl()["poses"][:, :66].reshape(-1, 22, 3))[..., :2, :]
                      .reshape(-1, 132))),
    Kind("split.npz", "`root_orient`, `pose_body`",
         lambda: smpl(poses=None, root_orient=smpl()["poses"][:, :3],
                      pose_body=smpl()["poses"][:, 3:66])),
    Kind("people.npz", "`pose_body` (people, T, 63), as SLAHMR's",
         lambda: {"root_orient": np.stack([y_up()[:, :3]] * 2), "trans": np.stack([walk()[1]] * 2),
                  "pose_body": np.stack([y_up()[:, 3:66]] * 2), "betas": np.zeros((2, 16))}, 60.0),
    Kind("pitched.npz", "a camera's world with its floor (SLAHMR)", lambda: of_camera(40), 60.0),
    Kind("no_floor.npz", "a camera's world without its floor",
         lambda: of_camera(-30, floor=False), 60.0, differs="roots by some degrees"),
    Kind("hy_motion.npz", "`Rh`, a copy of the root's turn (HY-Motion)",
         lambda: smpl(poses=y_up(156), trans=walk()[1], Rh=y_up()[:, :3])),
    Kind("zero_rate.npz", "a rate of 0", lambda: smpl(mocap_framerate=0.0)),
    Kind("zero_and_given.npz", "a rate of 0, and `--motion-fps`",
         lambda: smpl(mocap_framerate=0.0), 60.0),
    Kind("grab.npz", "a dictionary in a field (GRAB)",
         lambda: {"framerate": 60.0, "gender": "female", "contact": np.array({"object": 1}, object),
                  "body": np.array({"vtemp": "s1.ply", "params": _BODY | {
                      "fullpose": y_up(165)}}, object)}),
    Kind("omomo.npz", "`local_rot_aa`, `root_trans` (OMOMO)",
         lambda: {"local_rot_aa": y_up(66).reshape(-1, 22, 3), "root_trans": walk()[1]}, 60.0),
    Kind("prefixed.npz", "`smplh:body_pose` (Seamless Interaction)",
         lambda: {f"smplh:{name}": value for name, value in _BODY.items()}, 60.0),
    Kind("batch.npz", "(1, T, 72)", lambda: smpl(poses=smpl()["poses"][None, :, :72])),
    Kind("no_rate.npz", "no rate", lambda: smpl(mocap_framerate=None)),
    Kind("given_rate.npz", "no rate, and `--motion-fps`", lambda: smpl(mocap_framerate=None), 60.0),
    Kind("fps.npz", "`fps`, as text", lambda: smpl(mocap_framerate=None, fps="60")),
    Kind("object.npz", "gender and rate as objects",
         lambda: smpl(gender=np.array(None, object), mocap_framerate=np.array(60.0, object))),
    Kind("frames.npz", "betas a frame", lambda: smpl(betas=np.zeros((FRAMES, 10)))),
    Kind("no_betas.npz", "no betas", lambda: smpl(betas=None)),
    Kind("no_trans.npz", "no trans", lambda: smpl(trans=None), differs="places"),
    Kind("cm.npz", "centimetres", lambda: smpl(trans=100 * smpl()["trans"])),
    Kind("degrees.npz", "degrees", lambda: smpl(poses=np.degrees(smpl()["poses"]))),
    Kind("walk.smpl", "Meshcapade's `.smpl`",
         lambda: {"codecVersion": 1, "smplVersion": 2, "gender": 2, "frameRate": np.float32(60),
                  "shapeParameters": np.zeros(10, "f4"), "bodyTranslation": walk()[1].astype("f4"),
                  "bodyPose": y_up(66).reshape(-1, 22, 3).astype("f4")}),
    Kind("aistpp.pkl", "AIST++",
         lambda: pickle.dumps({"smpl_poses": y_up(), "smpl_trans": 93.7 * walk()[1],
                               "smpl_scaling": np.array([93.7])})),
    Kind("3dpw.pkl", "3DPW, two people",
         lambda: pickle.dumps({"poses": [y_up()[:9], y_up()], "trans": [walk()[1][:9], walk()[1]],
                               "betas": [np.ones(10), np.zeros(10)], "genders": ["m", "f"],
                               "poses_60Hz": []}, 2), 60.0),
    Kind("emdb.pkl", "EMDB",
         lambda: pickle.dumps({"gender": "female", "smpl": {
             "poses_root": y_up()[:, :3], "poses_body": y_up()[:, 3:], "trans": walk()[1],
             "betas": np.zeros(10)}}), 60.0),
    Kind("wham.pkl", "WHAM", lambda: pickle.dumps({0: person()}), 60.0),
    Kind("wham_joblib.pkl", "WHAM by joblib, two people",
         lambda: by_joblib({0: person(pose=y_up()[:9]), 7: person(pose_world=y_up(),
                            trans_world=walk()[1], pose=y_up() * 0)}), 60.0),
    Kind("unseen.pkl", "WHAM, 20 frames never seen", lambda: pickle.dumps(by_frames(
        np.setdiff1d(np.arange(FRAMES), np.arange(2, 82, 4)))), 60.0),
    Kind("long_gap.pkl", "WHAM, 40 frames never seen", lambda: pickle.dumps(by_frames(
        np.r_[:40, 80:90])), 60.0, differs="lengths"),
    Kind("prompthmr.pkl", "PromptHMR, two people",
         lambda: pickle.dumps({"camera": {"pred_cam_R": np.eye(3)}, "people": {
             4: {"smplx_world": {"pose": y_up(165)[:9], "trans": walk()[1][:9]}},
             7: {"frames": np.arange(FRAMES), "smplx_cam": {"pose": 0 * y_up(165)},
                 "smplx_world": {"pose": y_up(165), "shape": np.zeros(10), "trans": walk()[1]}},
         }}), 60.0),
    Kind("person.pkl", "the second of two people, and `--person`",
         lambda: pickle.dumps({"fps": 60.0, "a": person(pose=0 * y_up()), "b": person()}),
         how=HowRead(person=2)),
    Kind("phc.pkl", "PHC, compressed by joblib",
         lambda: zlib.compress(by_joblib({"0-walk": {
             "pose_aa": smpl()["poses"][:, :72], "trans_orig": smpl()["trans"],
             "beta": np.zeros(16), "gender": "neutral", "fps": 60}}))),
    Kind("phalp.pkl", "PHALP, by frame and compressed",
         lambda: zlib.compress(by_joblib({"0.jpg": _FRAME, "1.jpg": _FRAME}))),
    Kind("tram.npy", "TRAM",
         lambda: np.array({"pred_rotmat": matrices(y_up().reshape(-1, 24, 3))}, object)),
    Kind("gvhmr.pt", "GVHMR, a torch file",
         lambda: by_torch({"smpl_params_global": {
             "global_orient": y_up()[:, :3], "body_pose": y_up()[:, 3:66], "transl": walk()[1],
             "betas": np.zeros((FRAMES, 10))}}), 60.0),
    Kind("camera.pkl", "a camera's space alone",
         lambda: pickle.dumps({"smpl_params_incam": {"body_pose": y_up()[:, 3:66]}})),
    Kind("arctic.npy", "a dictionary (ARCTIC)",
         lambda: np.array({"global_orient": y_up()[:, :3], "body_pose": y_up()[:, 3:66],
                           "transl": walk()[1]}, object), 60.0),
    Kind("smpl_params.npy", "MDM's `smpl_params`",
         lambda: np.array({"motion": np.zeros((25, 6, FRAMES)), "root_translation": walk()[1].T,
                           "thetas": matrices(y_up().reshape(-1, 24, 3))[..., :2, :]
                           .reshape(-1, 24, 6).transpose(1, 2, 0)}, object), 60.0),
    Kind("easymocap.npy", "a dictionary of EasyMocap",
         lambda: np.array({"poses": y_up(), "Rh": y_up()[:, :3], "Th": walk()[1]}, object)),
    Kind("one_by_one.pkl", "a list of a pose a frame",
         lambda: pickle.dumps({"pose": [*y_up()[:, None]], "trans": [*walk()[1][:, None]]})),
    Kind("motion_x.npy", "Motion-X",
         lambda: np.hstack([y_up(309), walk()[1], np.zeros((FRAMES, 10))]), 60.0),
    Kind("new_joints.npy", "joints of HumanML3D, MDM", joints_m, 60.0, differs="twists"),
    Kind("features.npy", "features of HumanML3D", lambda: np.zeros((FRAMES, 263))),
    Kind("walk.fbx", "FBX, bones of all orders of rotation", scenes.fbx),
    Kind("z_up.fbx", "FBX, z up, metres", lambda: scenes.fbx(up="z", unit_cm=100.0)),
    Kind("takes.fbx", "FBX of two takes", lambda: scenes.fbx(takes={"short": 9, "walk": 90})),
    Kind("no_bind.fbx", "FBX without bind pose, whose bones stand in a T",
         lambda: scenes.fbx(bind=False, default="rest")),
    Kind("stands.fbx", "FBX without bind pose, whose bones stand as in its first frame",
         lambda: scenes.fbx(bind=False, default="first"), differs="collars and feet"),
    Kind("walks.fbx", "FBX without bind pose, whose bones stand in mid-step",
         lambda: scenes.fbx(bind=False)),
    Kind("cut.fbx", "FBX that is cut off", lambda: b"Kaydara FBX Binary"),
    Kind("walk.glb", "GLB with a skin", lambda: scenes.glb(*scenes.gltf())),
    Kind("no_skin.glb", "GLB of nodes alone", lambda: scenes.glb(*scenes.gltf(skin=False))),
    Kind("model.glb", "GLB without animation",
         lambda: scenes.glb(*scenes.gltf(animations={"still": 0}))),
    Kind("walk.vrma", "VRMA, bones by the extension's names", scenes.vrma),
)  # fmt: skip


def outcome(kind: Kind, folder: Path) -> tuple[str, bool]:
    """What came of it, in words, and whether that is right: as the reference, told or refused."""
    try:
        motion, said = kind.read(folder)
    except DsnetError as error:
        return f"refused: {error.received.partition(', ')[2].replace('|', '/')}", True
    turn_deg, place_m = apart(motion, reference(folder, kind))
    notes = "; ".join(line.replace(str(folder / kind.file), "").lstrip(":, ") for line in said)
    if turn_deg < MOST_DEG and place_m < MOST_M:
        return "as the reference" + (f"; told: {notes}" if notes else ""), not kind.differs
    return f"{kind.differs} differ; told: {notes}", bool(kind.differs and notes)


def reference(folder: Path, kind: Kind) -> Motion:
    """The walk on the skeleton of a BVH, or SMPL's."""
    of_bvh = kind.file.lower().endswith((".bvh", ".fbx", ".glb", ".vrma"))
    first = KINDS[0] if of_bvh else next(
        one for one in KINDS if one.file == "walk.npz"
    )  # fmt: skip
    return first.read(folder)[0]


def apart(motion: Motion, other: Motion) -> tuple[float, float]:
    """Largest mean turn of a joint, degrees, and of the root's place, metres."""
    if len(motion.theta) != len(other.theta):
        return np.inf, np.inf
    one, two = (Rotation.from_rotvec(m.pose.reshape(-1, 3)) for m in (motion, other))
    turns = np.degrees((one.inv() * two).magnitude()).reshape(-1, 22).mean(axis=0)
    return float(turns.max()), float(np.abs(motion.trans_m - other.trans_m).max())


def table(folder: Path) -> str:
    """The table of the page."""
    rows = ["| file | kind | what comes of it |", "|---|---|---|"]
    for kind in KINDS:
        came, right = outcome(kind, folder)
        assert right, (kind.file, came)
        rows.append(f"| `{kind.file}` | {kind.what} | {came} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        PAGE.write_text(f"{before}{BEGIN}{table(Path(name))}{END}{after}", encoding="utf-8")
