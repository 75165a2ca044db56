"""Motion files of every kind that people have, forged: one walk, on one skeleton, written by turns.

`python -m tests.forged.motion_kinds` reads them all and writes docs/results/motion_kinds.md.
"""

from __future__ import annotations

import contextlib
import io
import pickle
import re
import sys
import tempfile
import types
import warnings
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bridge.body import load_body_model
from bridge.body.model_data import SMPL_PARENTS
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError
from bridge.motion import Motion, load_motion, unpack_theta
from bridge.motion.motion import AS_IT_SAYS, HowRead
from bridge.motion.motion_checks import motion_warnings
from bridge.motion.skeletons import OWN_NAMES
from tests.forged.bvh import Skeleton, text, world_of

PAGE = Path(__file__).parents[2] / "docs" / "results" / "motion_kinds.md"
BEGIN, END = "<!-- kinds -->\n", "<!-- end of kinds -->"
FRAMES, FPS = 90, 60.0
MOST_DEG, MOST_M = 1.0, 0.01
MIXAMO = (
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot",
    "RightFoot", "Spine2", "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder", "RightShoulder",
    "Head", "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand",
    "LeftHandEnd", "RightHandEnd",
)  # fmt: skip
_HALF = {
    0: (0, 0, 0), 1: (9.5, -5, 0), 3: (0, 11, -0.5), 4: (9.5, -46, 0), 6: (0, 23, -0.5),
    7: (9.5, -86, 0), 9: (0, 35, -0.5), 10: (9.5, -93, 13), 12: (0, 51, -0.5),
    13: (5.5, 47.5, -0.5), 15: (0, 60, 1), 16: (17, 47.5, -0.5), 18: (44, 47.5, -0.5),
    20: (68.5, 47.5, -0.5), 22: (78.5, 47.5, -0.5),
}  # fmt: skip
REST_CM = np.array(
    [_HALF[n] if n in _HALF else np.multiply(_HALF[n - 1], (-1, 1, 1)) for n in range(24)], float
)
Turns = Mapping[int, np.ndarray]


def about(axis: str, degrees: float) -> np.ndarray:
    """(3, 3) rotation."""
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


@cache
def walk() -> tuple[np.ndarray, np.ndarray]:
    """Pose (T, 22, 3) and places of the pelvis (T, 3), metres, y up."""
    pose, places_m = unpack_theta(load_motion("sample:walking").theta[:FRAMES])
    return pose, np.asarray(places_m, np.float64)


def bvh(
    names: Sequence[str] = MIXAMO,
    frames: Turns | None = None,
    world: np.ndarray | None = None,
    mirror: bool = False,
) -> str:
    """The walk as a BVH.

    Parameters
    ----------
    frames : what turns a T's joints into the file's, by joint, others not at all.
    world : (3, 3) what turns y up into the file's world.
    mirror : whether x goes the other way round.
    """
    pose, places_m = walk()
    own = {joint: (frames or {}).get(joint, np.eye(3)) for joint in range(24)}
    outer = np.eye(3) if world is None else world
    turns = np.stack([outer @ world_of(pose)[:, n] @ own[n].T for n in range(24)], axis=1)
    rest = REST_CM.copy()
    for joint, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            rest[joint] = rest[parent] + own[parent] @ (REST_CM[joint] - REST_CM[parent])
    root = 100 * places_m @ outer.T
    if mirror:
        sign = np.diag([-1.0, 1.0, 1.0])
        turns, rest, root = sign @ turns @ sign, rest @ sign, root @ sign
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")  # where a world lies on its side
        return text(Skeleton(names, SMPL_PARENTS, rest), turns, root)


def undone_hips() -> str:
    """Joints of no length undo the root's turn."""
    pose, places_m = walk()
    world = world_of(pose)
    extra = ["LHipJoint", "RHipJoint", "LowerBack"]
    parents, rest = [*SMPL_PARENTS, 0, 0, 0], np.concatenate([REST_CM, np.zeros((3, 3))])
    parents[1], parents[2], parents[3] = 24, 25, 26
    turns = np.concatenate([world, np.repeat(world[:, :1], 3, axis=1)], axis=1)
    turns[:, 0] = world[:, 0] @ about("y", 80)
    order = [0, 24, 25, 26, *range(1, 24)]
    names = [[*MIXAMO, *extra][n] for n in order]
    moved = [-1 if parents[n] < 0 else order.index(parents[n]) for n in order]
    return text(Skeleton(names, moved, rest[order]), turns[:, order], 100 * places_m)


def named(middle: str, limbs: str, style: str) -> list[str]:
    """Names of hips, three of a spine, neck and head, then of a side's limbs in a style.

    Limbs are thigh, shin, foot, toe, collar, upper arm, forearm and hand; the style has `{side}`,
    `{s}`, `{S}` and `{name}`.
    """
    found: list[str] = [*MIXAMO]
    for number, name in zip((0, 3, 6, 9, 12, 15), middle.split(","), strict=True):
        found[number] = name
    for number, name in zip((1, 4, 7, 10, 13, 16, 18, 20), limbs.split(","), strict=True):
        for joint, side in ((number, "Left"), (number + 1, "Right")):
            found[joint] = style.format(side=side, s=side[0].lower(), S=side[0], name=name)
    return found


_X = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_ALONG_X: Turns = dict.fromkeys((0, 3, 6, 9, 12, 15), _X) | {
    **dict.fromkeys((1, 2, 4, 5), about("z", 90)),
    **dict.fromkeys((7, 8, 10, 11), about("y", 90)),
    **dict.fromkeys((14, 17, 19, 21), about("z", 180)),
}


def along_x(*, legs: float = 0, arms: float = 0, forearms: float = 0) -> Turns:
    """All bones along x, as LAFAN1's, and frames of limbs turned about them by so many degrees."""
    parts = {(1, 2, 4, 5): legs, (16, 17): arms, (18, 19, 20, 21): forearms}
    by = {joint: degrees for joints, degrees in parts.items() for joint in joints}
    return {n: about("x", by.get(n, 0)) @ _ALONG_X.get(n, np.eye(3)) for n in range(24)}


_RAISED: Turns = {
    **dict.fromkeys((13, 16, 18, 20, 22), about("z", 90)),
    **dict.fromkeys((14, 17, 19, 21, 23), about("z", -90)),
}
_TOES_DOWN: Turns = dict.fromkeys((7, 8, 10, 11), about("x", 62))


def _turned(degrees: float) -> Turns:
    return dict.fromkeys(range(24), about("y", degrees))


def _edited(*changes: tuple[str, str]) -> str:
    whole = bvh()
    for pattern, put in changes:
        whole, count = re.subn(pattern, put, whole, flags=re.MULTILINE)
        assert count, pattern
    return whole


def _root_reordered() -> str:
    head, _, rows = bvh().partition("Frame Time: 0.016666667\n")
    head = head.replace("Xposition Yposition Zposition", "Zposition Yposition Xposition")
    lines = [row.split(" ", 3) for row in rows.splitlines()]
    body = "\n".join(" ".join((z, y, x, *rest)) for x, y, z, *rest in lines)
    return f"{head}Frame Time: 0.016666667\n{body}\n"


def _two_people() -> str:
    head, _, rows = bvh().partition("MOTION\n")
    second = head.removeprefix("HIERARCHY\n")
    for name in MIXAMO:
        second = re.sub(rf"(ROOT|JOINT) {name}$", rf"\1 B_{name}", second, flags=re.MULTILINE)
    declared, time, *lines = rows.splitlines()
    body = "\n".join(f"{line} {line}" for line in lines)
    return f"{head}{second}MOTION\n{declared}\n{time}\n{body}\n"


def _flipped(name: str) -> str:
    """One leaf turned round in one frame."""
    whole = bvh()
    head, _, rows = whole.partition("Frame Time: 0.016666667\n")
    joints = re.findall(r"(?:ROOT|JOINT) (\w+)", head)
    column = 3 + 3 * joints.index(name)
    lines = [row.split() for row in rows.splitlines()]
    lines[40][column] = str(float(lines[40][column]) + 170)
    return f"{head}Frame Time: 0.016666667\n" + "\n".join(map(" ".join, lines)) + "\n"


def _in_radians() -> str:
    head, _, rows = bvh().partition("Frame Time: 0.016666667\n")
    numbers = np.array([row.split() for row in rows.splitlines()], float)
    numbers[:, 3:] = np.radians(numbers[:, 3:])
    body = "\n".join(" ".join(map(str, row)) for row in numbers)
    return f"{head}Frame Time: 0.016666667\n{body}\n"


def smpl(**changes: Any) -> dict[str, Any]:
    """SMPL-H's arrays of the walk, z up, as AMASS has them; a change to None leaves one out."""
    pose, places_m = walk()
    turned = about("x", 90)
    poses = np.zeros((FRAMES, 156))
    poses[:, :66] = pose.reshape(FRAMES, 66)
    poses[:, :3] = Rotation.from_matrix(turned @ _matrices(pose[:, 0])).as_rotvec()
    arrays = {"poses": poses, "trans": places_m @ turned.T, "betas": np.zeros(16),
              "gender": "female", "mocap_framerate": FPS} | changes  # fmt: skip
    return {name: value for name, value in arrays.items() if value is not None}


def _matrices(rotvecs: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix().reshape(*rotvecs.shape, 3)


def y_up(width: int = 72) -> np.ndarray:
    """(T, width) poses of a world with y up."""
    pose, _ = walk()
    return np.pad(pose.reshape(FRAMES, 66), ((0, 0), (0, width - 66)))


def joints_m() -> np.ndarray:
    """(T, 22, 3) places of SMPL's joints, y up."""
    rest_m = shaped_joints(load_body_model("embedded:female"), np.zeros((1, 10)))[0]
    pose, places_m = walk()
    world, found = world_of(pose), np.zeros((FRAMES, 22, 3))
    found[:, 0] = places_m
    for joint in range(1, 22):
        parent = SMPL_PARENTS[joint]
        found[:, joint] = found[:, parent] + world[:, parent] @ (rest_m[joint] - rest_m[parent])
    return found


def person(**changes: Any) -> dict[str, Any]:
    """What WHAM says of one."""
    found = {"pose": y_up(), "trans": walk()[1], "betas": np.zeros((FRAMES, 10)),
             "frame_ids": np.arange(FRAMES)}  # fmt: skip
    return found | changes


def by_joblib(found: Any) -> bytes:
    """As joblib pickles: each array a small object, after which its numbers stand in the file."""
    wrapped = _stand_in("joblib.numpy_pickle", "NumpyArrayWrapper")

    class Pickler(pickle._Pickler):  # type: ignore[attr-defined]
        def save(self, obj: Any, save_persistent_id: bool = True) -> None:
            save: Any = super().save  # type: ignore[misc]
            if not isinstance(obj, np.ndarray):
                save(obj, save_persistent_id)
                return
            wrapper = wrapped()
            wrapper.__dict__ |= {
                "subclass": np.ndarray, "shape": obj.shape, "order": "C", "dtype": obj.dtype,
                "allow_mmap": True, "numpy_array_alignment_bytes": 16,
            }  # fmt: skip
            save(wrapper, save_persistent_id)
            self.framer.commit_frame(force=True)  # type: ignore[attr-defined]
            self.framer.file_write(b"\3" + b"\xff" * 3 + obj.tobytes())  # type: ignore[attr-defined]

    stream = io.BytesIO()
    with _modules(wrapped):
        Pickler(stream, protocol=4).dump(found)
    return stream.getvalue()


def by_torch(found: Any) -> bytes:
    """As `torch.save` writes arrays: a pickle of tensors, their numbers in files beside it."""
    rebuild = _stand_in("torch._utils", "_rebuild_tensor_v2")
    storages = {kind: _stand_in("torch", f"{name}Storage")
                for kind, name in {"f": "Double", "b": "Bool"}.items()}  # fmt: skip
    numbers: list[bytes] = []

    class Pickler(pickle._Pickler):  # type: ignore[attr-defined]
        def reducer_override(self, obj: Any) -> Any:
            if not isinstance(obj, np.ndarray):
                return NotImplemented
            kind = "b" if obj.dtype == bool else "f"
            numbers.append(obj.astype("<f8" if kind == "f" else bool).tobytes())
            steps = np.cumprod([1, *obj.shape[:0:-1]])[::-1].tolist()
            kept = types.SimpleNamespace(key=str(len(numbers) - 1), size=obj.size, kind=kind)
            return rebuild, (kept, 0, obj.shape, tuple(steps), False, OrderedDict())

        def persistent_id(self, obj: Any) -> Any:
            if isinstance(obj, types.SimpleNamespace):
                return "storage", storages[obj.kind], obj.key, "cpu", obj.size
            return None

    stream, whole = io.BytesIO(), io.BytesIO()
    with _modules(rebuild, *storages.values()):
        Pickler(stream, protocol=2).dump(found)
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr("results/data.pkl", stream.getvalue())
        for key, data in enumerate(numbers):
            archive.writestr(f"results/data/{key}", data)
    return whole.getvalue()


def _stand_in(module: str, name: str) -> type:
    """A class that is pickled by another's name."""
    return type(name, (), {"__module__": module, "__qualname__": name})


@contextlib.contextmanager
def _modules(*stand_ins: type) -> Iterator[None]:
    """Modules in which stand-ins are found."""
    names = {name for one in stand_ins for name in (one.__module__, one.__module__.split(".")[0])}
    known = {name: sys.modules.get(name) for name in names}
    for name in names:
        sys.modules[name] = types.ModuleType(name)
    for one in stand_ins:
        setattr(sys.modules[one.__module__], one.__name__, one)
    try:
        yield
    finally:
        for name, before in known.items():
            sys.modules.pop(name)
            if before is not None:
                sys.modules[name] = before


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
_NUMBERED = [f"bone{number}" for number in range(24)]

KINDS = (
    Kind("walk.bvh", "Mixamo's names, a T at rest", bvh),
    Kind("collars.bvh", "collars and arms raised at rest", lambda: bvh(frames=_RAISED)),
    Kind("along_x.bvh", "all bones along x, as LAFAN1's",
         lambda: bvh(frames=along_x(legs=180, arms=90)),
         differs="feet"),
    Kind("toes_down.bvh", "toes down at rest", lambda: bvh(frames=_TOES_DOWN), differs="feet"),
    Kind("turned.bvh", "rest pose turned by 45 degrees", lambda: bvh(frames=_turned(45))),
    Kind("z_world.bvh", "rests with y up, world with z up", lambda: bvh(world=about("x", 90))),
    Kind("upside_down.bvh", "rests with y up, world with -y up",
         lambda: bvh(world=about("z", 180))),
    Kind("left_handed.bvh", "left-handed", lambda: bvh(mirror=True)),
    Kind("undone.bvh", "joints of no length undo the hips' turn", undone_hips),
    Kind("toe.bvh", "a toe flips", lambda: _flipped("LeftToeBase"), differs="toes"),
    Kind("wrist.bvh", "a wrist flips", lambda: _flipped("RightHand"), differs="wrists"),
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
    Kind("map.bvh", "other names, and `--joint-map`", lambda: bvh(_NUMBERED),
         how=HowRead(joint_map=dict(zip(OWN_NAMES, _NUMBERED, strict=False)))),
    Kind("numbered.bvh", "other names", lambda: bvh(_NUMBERED)),
    Kind("root_zyx.bvh", "the root's positions in another order", _root_reordered),
    Kind("latin.bvh", "latin-1", lambda: _edited((r"JOINT RightHandEnd", "JOINT Höcker"))
         .encode("latin-1")),
    Kind("CAPITALS.BVH", "name in capitals", bvh),
    Kind("more.bvh", "one frame more declared", lambda: _edited((r"^Frames: 90", "Frames: 91"))),
    Kind("two.bvh", "two people", _two_people),
    Kind("no_blank.bvh", "`Frame Time:x`", lambda: _edited((r"^(Frame.*): ", r"\1:"))),
    Kind("radians.bvh", "angles in radians", _in_radians, differs="limbs"),
    Kind("nan.bvh", "numbers that are none", lambda: _edited((r"\A(.*\n)+.*\s\S+$", r"\g<0> nan"))),
    Kind("walk.npz", "AMASS, SMPL-H", smpl),
    Kind("y_up.npz", "y up with AMASS's keys (BEAT2, GVHMR)",
         lambda: smpl(poses=y_up(165), trans=walk()[1])),
    Kind("66.npz", "66 numbers a frame", lambda: smpl(poses=smpl()["poses"][:, :66])),
    Kind("24x3.npz", "(T, 24, 3)", lambda: smpl(poses=smpl()["poses"][:, :72].reshape(-1, 24, 3))),
    Kind("matrices.npz", "(T, 22, 3, 3)",
         lambda: smpl(poses=_matrices(smpl()["poses"][:, :66].reshape(-1, 22, 3)))),
    Kind("132.npz", "132: two lines of each matrix",
         lambda: smpl(poses=_matrices(smpl()["poses"][:, :66].reshape(-1, 22, 3))[..., :2, :]
                      .reshape(-1, 132))),
    Kind("split.npz", "`root_orient`, `pose_body`",
         lambda: smpl(poses=None, root_orient=smpl()["poses"][:, :3],
                      pose_body=smpl()["poses"][:, 3:66])),
    Kind("people.npz", "`pose_body` (people, T, 63), as SLAHMR's",
         lambda: {"root_orient": np.stack([y_up()[:, :3]] * 2), "trans": np.stack([walk()[1]] * 2),
                  "pose_body": np.stack([y_up()[:, 3:66]] * 2), "betas": np.zeros((2, 16))}, 60.0),
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
                           "thetas": _matrices(y_up().reshape(-1, 24, 3))[..., :2, :]
                           .reshape(-1, 24, 6).transpose(1, 2, 0)}, object), 60.0),
    Kind("easymocap.npy", "a dictionary of EasyMocap",
         lambda: np.array({"poses": y_up(), "Rh": y_up()[:, :3], "Th": walk()[1]}, object)),
    Kind("one_by_one.pkl", "a list of a pose a frame",
         lambda: pickle.dumps({"pose": [*y_up()[:, None]], "trans": [*walk()[1][:, None]]})),
    Kind("motion_x.npy", "Motion-X",
         lambda: np.hstack([y_up(309), walk()[1], np.zeros((FRAMES, 10))]), 60.0),
    Kind("new_joints.npy", "joints of HumanML3D, MDM", joints_m, 60.0, differs="twists"),
    Kind("features.npy", "features of HumanML3D", lambda: np.zeros((FRAMES, 263))),
    Kind("walk.fbx", "FBX", lambda: b"Kaydara FBX Binary"),
)  # fmt: skip


def outcome(kind: Kind, folder: Path) -> tuple[str, bool]:
    """What came of it, in words, and whether that is right: as the reference, told or refused."""
    try:
        motion, said = kind.read(folder)
    except DsnetError as error:
        return f"refused: {error.received.partition(', ')[2].replace('|', '/')}", True
    turn_deg, place_m = apart(motion, reference(folder, kind))
    notes = "; ".join(line.replace(str(folder / kind.file), "").lstrip(": ") for line in said)
    if turn_deg < MOST_DEG and place_m < MOST_M:
        return "as the reference" + (f"; told: {notes}" if notes else ""), not kind.differs
    return f"{kind.differs} differ; told: {notes}", bool(kind.differs and notes)


def reference(folder: Path, kind: Kind) -> Motion:
    """The walk on the skeleton of a BVH, or SMPL's."""
    first = KINDS[0] if kind.file.lower().endswith(".bvh") else next(
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
