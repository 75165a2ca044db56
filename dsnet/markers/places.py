"""Places of the body that markers are named after: other names of them, and where those on bone lie
on a body at rest.

Names are Plug-in Gait's, the Conventional Gait Model's, ISB's and IOR's, and those of the marker
sets of Qualisys, OptiTrack and AMASS's sources. A place on bone is told as one would tell a person:
from which joint to which side the skin is met, so that it is found on any body with SMPL's joints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SMPL_JOINT_NAMES, BodyModelData
from bridge.body.surface_operators import vertex_normals
from bridge.motion.directions import unit

_OF_MIDDLE = {
    "TOPBACK": "C7", "CV7": "C7", "BACKTOP": "C7", "SPINETOP": "C7", "MIDBACK": "T10",
    "TV10": "T10", "TV8": "T8", "R10": "RBAK", "CHEST": "CLAV", "SJN": "CLAV", "SXS": "STRN",
    "BACKLEFT": "LBAK", "BACKRIGHT": "RBAK", "WAISTLFRONT": "LFWT", "WAISTRFRONT": "RFWT",
    "WAISTLBACK": "LBWT", "WAISTRBACK": "RBWT", "WAISTBACK": "SACR", "SACRUM": "SACR",
    "VSACRAL": "SACR", "VSACRUM": "SACR", "HEADTOP": "ARIEL",
}  # fmt: skip
_OF_SIDES = {
    "BAK": "BAC", "SHO": "FSH SHOULDER SAE SHOULDERTOP", "ELB": "ELBOW HLE ELBOWOUT",
    "MEL": "HME ELBOWIN ELBI", "IWR": "WRA RSP WRISTIN", "OWR": "WRB USP WRISTOUT",
    "FIN": "HM2 HANDOUT", "THI": "HIP THIGH", "TIB": "LEG SHIN", "KNE": "KNEE FLE KNEEOUT",
    "KNI": "KNM MKNE FME KNEEIN", "ANK": "ANKLE FAL ANKLEOUT", "ANI": "MED TAM MANK ANKLEIN",
    "HEE": "HEEL FCC HEELBACK", "TOE": "FM2 SMH", "MT5": "FM5 VMH TOEOUT FOREFOOTOUT",
    "MT1": "FM1 FMH TOEIN FOREFOOTIN", "ASI": "IAS ASIS", "PSI": "IPS PSIS",
}  # fmt: skip
SAME_PLACE = _OF_MIDDLE | {
    f"{side}{other}": side + name
    for side in "LR"
    for name, others in _OF_SIDES.items()
    for other in others.split()
}
"""The name that this package has of a place, by another one, in capitals without underscores."""

_FROM_JOINTS = {
    "ARIEL": ("head", (0, 1, 0)), "C7": ("neck", (0, 0.2, -1)), "T8": ("spine3", (0, -0.6, -1)),
    "T10": ("spine2", (0, 0.1, -1)), "CLAV": ("neck", (0, -0.8, 1)),
    "STRN": ("spine2", (0, 0.3, 1)), "SACR": ("pelvis", (0, 0.7, -0.7)),
    "*FHD": ("head", (0.5, 1, 0.9)), "*BHD": ("head", (0.5, 1, -0.8)),
    "*BAK": ("spine3", (0.9, 0.8, -0.7)), "*ASI": ("pelvis", (1, 0.42, 1.05)),
    "*PSI": ("pelvis", (0.75, 0.85, -0.65)), "*FWT": ("pelvis", (1, 0.42, 1.05)),
    "*BWT": ("pelvis", (0.75, 0.85, -0.65)), "*SHO": ("*_shoulder", (-0.15, 1, 0)),
    "*ELB": ("*_elbow", (0, 0.7, -0.7)), "*MEL": ("*_elbow", (0, -1, 0)),
    "*IWR": ("*_wrist", (0, 0.1, 1)), "*OWR": ("*_wrist", (0, 0, -1)),
    "*FIN": ("*_wrist", (1, 0.25, 0)), "*KNE": ("*_knee", (1, 0, -0.1)),
    "*KNI": ("*_knee", (-1, 0, 0)), "*ANK": ("*_ankle", (1, 0, -0.1)),
    "*ANI": ("*_ankle", (-1, 0, 0.1)), "*HEE": ("*_ankle", (0, -0.6, -1)),
    "*TOE": ("*_foot", (-0.2, 1, 0.1)), "*MT5": ("*_foot", (1, -0.1, -0.3)),
    "*MT1": ("*_foot", (-1, -0.1, 0)),
}  # fmt: skip
"""Joint and direction in the rest pose: x to the left, y up, z to the front; `*` stands for the
side, here the left one."""
ON_BONE = {
    label.replace("*", letter): (joint.replace("*", side), np.array(way) * [sign, 1, 1])
    for label, (joint, way) in _FROM_JOINTS.items()
    for letter, side, sign in (("L", "left", 1), ("R", "right", -1))
}
_NEAR_M = 0.015


def bony_vertices(body: BodyModelData, labels: list[str]) -> NDArray[np.intp]:
    """The vertex of a body's template that each marker of `ON_BONE` is on."""
    normals = vertex_normals(body.v_template, body.faces)
    mainly, found = body.body_weights.argmax(axis=1), []
    for joint, way in (ON_BONE[label] for label in labels):
        row, along = SMPL_JOINT_NAMES.index(joint), unit(way)
        from_joint_m = body.v_template - body.joints[row]
        far_m = from_joint_m @ along
        beside_m = np.linalg.norm(from_joint_m - far_m[:, None] * along, axis=1)
        bones = [row, body.parents[row], *np.flatnonzero(body.parents == row)]
        ahead = (far_m > 0) & (normals @ along > 0) & np.isin(mainly, bones)
        beside_m = np.where(ahead, beside_m, np.inf)
        # Not a surface inside the body, as that of a mouth.
        near = beside_m < beside_m.min() + _NEAR_M
        found.append(int(np.where(near, far_m, 0).argmax()))
    return np.array(found)
