"""`python -m benchmarks.real_motions --folder FOLDER --out FILE.json`: what comes of real files.

Each file is read as `dsnet predict` reads it, and by hand: BVH by a small reader of its own, with
the joints and the vertical that `FILES` names; arrays by NumPy. Compared are the directions of
thighs, shins, upper arms and forearms in every frame, the lines of hips, shoulders and trunk, in
which builds differ, and the way of the hips, theirs scaled by the length of the legs. The files
have licences of their own and lie elsewhere; the result has their digests. Half a minute.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.processes import run_as_process
from bridge.body.model_data import SMPL_PARENTS
from bridge.errors import DsnetError, notify
from bridge.motion.motion import Y_UP_FROM_Z_UP, UpAxis
from bridge.motion.readers import read_motion_file
from bridge.motion.retargeting import mean_joints
from bridge.motion.skeletons import OWN_NAMES, SIDES
from bridge.motion.theta import unpack_theta
from bridge.paper import N_JOINTS
from bridge.runs.files import write_text_atomically

Places = Mapping[str, NDArray[np.float64]]
"""(T, 3) by SMPL's names, y up."""
PARTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
LINES: dict[str, Callable[[Places], NDArray]] = {
    "hips": lambda at: at["left_hip"] - at["right_hip"],
    "shoulders": lambda at: at["left_shoulder"] - at["right_shoulder"],
    "trunk": lambda at: (
        at["left_shoulder"] + at["right_shoulder"] - at["left_hip"] - at["right_hip"]
    ),
}
ROW = "| {origin} | {files} | {frames} | {limbs_deg:.1f} | {lines} | {travel} |"
HEAD = """\
| origin | files | frames | limbs [°] | hips, shoulders, trunk [°] | travel [cm a metre] |
|---|---:|---:|---:|---:|---:|
"""


@dataclass(frozen=True)
class Skeleton:
    """How files call what `PARTS` lists."""

    joints: str
    """Six names, `{}` for the side."""
    sides: tuple[str, str] = ("Left", "Right")

    def named(self) -> dict[str, str]:
        """Theirs by SMPL's names."""
        return {
            f"{side}_{part}": joint.format(theirs)
            for side, theirs in zip(SIDES, self.sides, strict=True)
            for part, joint in zip(PARTS, self.joints.split(), strict=True)
        }


HUMAN_IK = Skeleton("{}UpLeg {}Leg {}Foot {}Arm {}ForeArm {}Hand")
BIOVISION = Skeleton("{}Hip {}Knee {}Ankle {}Shoulder {}Elbow {}Wrist")


_BANDAI = (
    "BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset:dataset/"
    "Bandai-Namco-Research-Motiondataset-1/data/dataset-1_"
)
_DME = "DeepMotionEditing/deep-motion-editing:style_transfer/data/"
_GANIMATOR, _MOCAPNET = "PeizhuoLi/ganimator:data/", "FORTH-ModelBasedTracker/MocapNET:dataset/"


def mixamo(prefix: str) -> Skeleton:
    return Skeleton(" ".join(f"{prefix}:{name}" for name in HUMAN_IK.joints.split()))


BANDAI = Skeleton("UpperLeg_{} LowerLeg_{} Foot_{} UpperArm_{} LowerArm_{} Hand_{}", ("L", "R"))
MIXAMO, MIXAMO_7 = mixamo("mixamorig"), mixamo("mixamorig7")
MAKEHUMAN = Skeleton("{}hip {}knee {}foot {}shoulder {}elbow {}hand", ("l", "r"))


@dataclass(frozen=True)
class RealFile:
    """One file that somebody made, and how a person reads it."""

    origin: str
    source: str
    """Repository on GitHub, and path in it."""
    skeleton: Skeleton | None = None
    """Of a BVH."""
    up: UpAxis = "y"


FILES: dict[str, RealFile] = {
    "bandai_walk.bvh": RealFile("Bandai-Namco", _BANDAI + "walk_normal_001.bvh", BANDAI),
    "bandai_dash.bvh": RealFile("Bandai-Namco", _BANDAI + "dash_active_001.bvh", BANDAI),
    "xia_strutting.bvh": RealFile("Xia et al.", _DME + "xia_test/strutting_01_000.bvh", HUMAN_IK),
    "xia_proud.bvh": RealFile("Xia et al.", _GANIMATOR + "Xia/proud.bvh", HUMAN_IK),
    "cmu_01_01.bvh": RealFile(
        "CMU, for MotionBuilder", "facebookresearch/fairmotion:tests/data/01_01.bvh", HUMAN_IK
    ),
    "cmu_12_01.bvh": RealFile(
        "CMU, for MotionBuilder", "VictorS-67/pybvh:bvh_data/cmu_12_01_walk.bvh", HUMAN_IK
    ),
    "daz_05_01.bvh": RealFile(
        "CMU, on MakeHuman's bones", _MOCAPNET + "CMU_Sample_05_01.bvh", MAKEHUMAN
    ),
    "mocapnet_leftkick.bvh": RealFile(
        "CMU, on MakeHuman's bones", _MOCAPNET + "gestures/leftkick.bvh", MAKEHUMAN
    ),
    "mixamo_salsa.bvh": RealFile("Mixamo", _GANIMATOR + "Joe/Salsa-Dancing-6.bvh", MIXAMO_7),
    "mixamo_circle.bvh": RealFile("Mixamo", _GANIMATOR + "Joe/Walk-In-Circle.bvh", MIXAMO_7),
    "mixamo_gangnam.bvh": RealFile("Mixamo", _GANIMATOR + "Malcolm/Gangnam-Style.bvh", MIXAMO),
    "freebvh.bvh": RealFile("Mixamo", "20tab/bvh-python:tests/test_freebvh.bvh", MIXAMO),
    "movingstories_walk.bvh": RealFile(
        "MovingStories", "omimo/PyMO:demos/data/AV_8Walk_Meredith_HVHA_Rep1.bvh", HUMAN_IK
    ),
    "mocapbank.bvh": RealFile("Mocapbank", "20tab/bvh-python:tests/test_mocapbank.bvh", BIOVISION),
    "toolbox_walk01.bvh": RealFile(
        "bvh-toolbox", "OlafHaag/bvh-toolbox:tests/example_files/source/walk01.bvh", HUMAN_IK
    ),
    "aitviewer.bvh": RealFile(
        "aitviewer", "eth-ait/aitviewer:examples/resources/bvh/sample.bvh", BIOVISION
    ),
    "pybvh_1.bvh": RealFile("pybvh", "VictorS-67/pybvh:bvh_data/bvh_test1.bvh", HUMAN_IK, "z"),
    "pybvh_2.bvh": RealFile("pybvh", "VictorS-67/pybvh:bvh_data/bvh_test2.bvh", BIOVISION),
    "pybvh_3.bvh": RealFile("pybvh", "VictorS-67/pybvh:bvh_data/bvh_test3.bvh", HUMAN_IK, "z"),
    "video2bvh_cxk.bvh": RealFile(
        "video2bvh", "KevinLTT/video2bvh:miscs/cxk_cache/cxk.bvh", HUMAN_IK, "z"
    ),
    "humanml3d_012314.npy": RealFile(
        "HumanML3D", "EricGuo5513/HumanML3D:HumanML3D/new_joints/012314.npy"
    ),
    "amass_sample.npz": RealFile(
        "AMASS", "nghorbani/amass:support_data/github_data/amass_sample.npz", up="z"
    ),
    "hbp_amass_sample.npz": RealFile(
        "AMASS", "nghorbani/human_body_prior:support_data/dowloads/amass_sample.npz", up="z"
    ),
    "avatar.smpl": RealFile("Meshcapade", "Meshcapade/smplcodec:test/files/avatar.smpl"),
    "meshcapade_apose.npz": RealFile(
        "Meshcapade", "Meshcapade/smplcodec:test/files/apose_to_handsFront_smplx.npz"
    ),
}


@dataclass(frozen=True)
class RealConfig:
    """Write the result."""

    folder: Path
    """With the files that `FILES` names."""
    out: Path
    """A .json."""


def main(config: RealConfig) -> None:
    """Compare every file.

    Raises
    ------
    DsnetError
        If a file is missing.
    """
    if missing := [name for name in FILES if not (config.folder / name).is_file()]:
        raise DsnetError(
            f"{config.folder} without {', '.join(missing)}",
            "the files that benchmarks/real_motions.py names",
            "Copy them there from the repositories that stand beside them.",
        )
    found = {}
    for name, real in FILES.items():
        notify(f"{real.origin}: {name}")
        found[name] = compared(config.folder / name, real)
    command = " ".join(["python", "-m", "benchmarks.real_motions", *sys.argv[1:]])
    text = json.dumps({"files": found, "command": command}, indent=1)
    write_text_atomically(config.out, text + "\n")


def compared(path: Path, real: RealFile) -> dict[str, Any]:
    """What our reading and the other one differ by, and what ours says."""
    about = {
        "origin": real.origin,
        "source": real.source,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }
    try:
        motion = read_motion_file(path)
    except DsnetError as error:
        return {**about, "refused": str(error)}
    rest_m = mean_joints()
    pose, trans_m = unpack_theta(motion.about_root_joint(rest_m[0]).theta)
    ours = posed(pose, trans_m, rest_m, motion.up)
    theirs = by_hand(path, real, rest_m)
    theirs = {name: places[motion.rest_pose_frames :] for name, places in theirs.items()}
    limbs_deg = {
        f"{side}_{one}": angle_deg(*(
            places[f"{side}_{end}"] - places[f"{side}_{one}"] for places in (ours, theirs)
        ))
        for side in SIDES
        for one, end in BONES
    }  # fmt: skip
    lines_deg = {
        name: angle_deg(*(line(places) for places in (ours, theirs)))
        for name, line in LINES.items()
    }
    return {
        **about,
        "frames": len(pose),
        "limbs_deg": float(np.mean([*limbs_deg.values()])),
        "worst_limb_deg": max(limbs_deg.values()),
        "lines_deg": lines_deg,
        "travel_cm_a_metre": travel_cm_a_metre(ours, theirs),
        "told": [note.replace(str(path), path.name) for note in motion.notes],
    }


def by_hand(path: Path, real: RealFile, rest_m: NDArray) -> Places:
    """Joints as another reading has them."""
    if real.skeleton is not None:
        places = bvh_places(path)
        return {ours: turned(places[to], real.up) for ours, to in real.skeleton.named().items()}
    stored = np.load(path, allow_pickle=False)
    if path.suffix == ".npy":
        return {name: turned(stored[:, number], real.up) for number, name in enumerate(OWN_NAMES)}
    pose, trans = ("bodyPose", "bodyTranslation") if "bodyPose" in stored else ("poses", "trans")
    pose = stored[pose].reshape(len(stored[pose]), -1, 3)[:, :N_JOINTS]
    return posed(pose, stored[trans], rest_m, real.up)


def bvh_places(path: Path) -> Places:
    """Of a BVH's joints, (T, 3) by its own names: a reader of its own, which checks nothing."""
    head, _, tail = path.read_text(encoding="latin-1").partition("MOTION")
    lines = tail.splitlines()
    numbers = np.array([line.split() for line in lines[3:] if line.strip()], float)
    open_joints: list[str] = []
    world, places, parent, column = {}, {}, "", 0
    tokens = iter(head.replace("End Site", "JOINT End").split())
    for token in tokens:
        if token in ("ROOT", "JOINT"):
            open_joints.append(next(tokens))
        elif token == "OFFSET":
            bone = np.tile([float(next(tokens)) for _ in range(3)], (len(numbers), 1))
            joint, parent = open_joints[-1], (["", *open_joints])[-2]
            turn, place = Rotation.identity(len(numbers)), bone
        elif token == "CHANNELS":
            for _ in range(int(next(tokens))):
                channel = next(tokens)
                values = numbers[:, column]
                column += 1
                if channel.endswith("position"):
                    place[:, "XYZ".index(channel[0])] = values
                else:
                    axis, angles = channel[0].lower(), values[:, None]
                    turn = turn * Rotation.from_euler(axis, angles, degrees=True)
            world[joint] = world[parent] * turn if parent else turn
            places[joint] = places[parent] + world[parent].apply(place) if parent else place
        elif token == "}":
            open_joints.pop()
    return places


def posed(pose: NDArray, trans_m: NDArray, rest_m: NDArray, up: UpAxis) -> Places:
    """SMPL's joints of rotations (T, 22, 3) and translations (T, 3)."""
    world, places = [Rotation.from_rotvec(pose[:, 0])], [rest_m[0] + trans_m]
    for joint, parent in enumerate(SMPL_PARENTS[1:N_JOINTS], 1):
        places.append(places[parent] + world[parent].apply(rest_m[joint] - rest_m[parent]))
        world.append(world[parent] * Rotation.from_rotvec(pose[:, joint]))
    return {name: turned(one, up) for name, one in zip(OWN_NAMES, places, strict=True)}


def turned(places: NDArray, up: UpAxis) -> NDArray[np.float64]:
    """With y up."""
    return Y_UP_FROM_Z_UP.apply(places) if up == "z" else np.asarray(places, np.float64)


def angle_deg(one: NDArray, other: NDArray) -> float:
    """Mean angle between directions (T, 3)."""
    across, along = np.cross(one, other), (one * other).sum(axis=1)
    return float(np.degrees(np.arctan2(np.linalg.norm(across, axis=1), along)).mean())


def travel_cm_a_metre(ours: Places, theirs: Places) -> float | None:
    """By how much both hips' ways differ, on average over every metre that theirs go; None of who
    goes less than one."""
    scale = legs(ours) / legs(theirs)
    way_m, other_m = (0.5 * (places["left_hip"] + places["right_hip"]) for places in (ours, theirs))
    other_m = scale * other_m
    gone_m = np.r_[0, np.cumsum(np.linalg.norm(np.diff(other_m, axis=0), axis=1))]
    starts = np.flatnonzero(gone_m <= gone_m[-1] - 1)
    if not len(starts):
        return None
    ends = np.searchsorted(gone_m, gone_m[starts] + 1)
    apart_m = (way_m[ends] - way_m[starts]) - (other_m[ends] - other_m[starts])
    return float(100 * np.linalg.norm(apart_m, axis=1).mean())


def legs(places: Places) -> float:
    """Median length of thighs and shins."""
    bones = [places[f"{s}_{end}"] - places[f"{s}_{one}"] for s in SIDES for one, end in BONES[:2]]
    return float(np.median(np.linalg.norm(bones, axis=2).sum(axis=0)))


def markdown(path: Path) -> str:
    """The table of a result: a line an origin, its worst file's limb; and how many are refused."""
    given = json.loads(path.read_text(encoding="utf-8"))["files"].values()
    files, rows = [one for one in given if "refused" not in one], []
    for origin in dict.fromkeys(one["origin"] for one in files):
        own = [one for one in files if one["origin"] == origin]
        lines_deg = (max(one["lines_deg"][name] for one in own) for name in LINES)
        gone = [one["travel_cm_a_metre"] for one in own if one["travel_cm_a_metre"] is not None]
        rows.append(
            ROW.format(
                origin=origin,
                files=len(own),
                frames=sum(one["frames"] for one in own),
                limbs_deg=max(one["worst_limb_deg"] for one in own),
                lines=", ".join(f"{deg:.1f}" for deg in lines_deg),
                travel=f"{max(gone):.1f}" if gone else "in place",
            )
        )
    refused = len(given) - len(files)
    return HEAD + "\n".join(rows) + (f"\n\nRefused: {refused} of {len(given)}." if refused else "")


if __name__ == "__main__":
    run_as_process(RealConfig, main)
