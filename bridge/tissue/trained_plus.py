"""A trained `dsnet_plus` as arrays, and what it says of one person's tissue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import joint_rotations, pose_features
from bridge.errors import DsnetError
from bridge.exchange.weights import load_weights
from bridge.motion import unpack_theta
from bridge.paper import N_BETAS
from bridge.runs import Artifact
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import STEPS

NAME = "dsnet_plus"
NODE_FIELDS = (
    "omega", "damping_ratio", "stiffening", "sag", "normal_ratio", "wave_speed", "bending",
    "inertia_gain", "gravity_gain",
)  # fmt: skip
_LEARNED = ("slopes", "stiffening_power", "residual", "taps")
SAG_POWER = -2.0
"""How log sag follows what log W of a person has besides: weight over stiffness."""
KERNEL_WIDTH, _KERNEL_NOISE = 2.5, 1e-2
"""Of the Gaussian between two shapes' betas."""
_MOST_FRAMES_AHEAD = 60
_AXES: dict[str, tuple[int | str, ...]] = {
    "nodes/vertices": ("K",),
    "nodes/owners": ("V", "near"),
    "nodes/shares": ("V", "near"),
    "nodes/areas_m2": ("V",),
    "nodes/edges": ("E", 2),
    "nodes/pulls_m2": ("E",),
    **{f"log_{name}": ("K", 1) for name in NODE_FIELDS},
    "people_betas": ("P", N_BETAS),
    "slopes": (3, 1),
    "stiffening_power": (1,),
    "residual": ("P", "K", 1),
    "taps": ("N",),
    "constant_m": ("C", "CV", 3),
    "by_pose_m": ("F", "FK", 3),
    "look_ahead": (1,),
    "steps": (1,),
}
_ELSEWHERE: dict[str, tuple[int | str, ...]] = {
    "elsewhere/to_betas": ("S", N_BETAS),
    "elsewhere/shift": (N_BETAS,),
    "elsewhere/template": ("K", 3),
}
"""Shapes of a file's arrays: what has one name is one size."""


@dataclass(frozen=True, eq=False)
class Weights:
    """What training learns; logarithms, so that everything stays positive."""

    base: Mapping[str, NDArray]
    """By name of `NODE_FIELDS`, (K, 1): the logarithm for the template's body."""
    slopes: NDArray[np.float32]
    """(3, 1) how log W follows `shape_features`."""
    stiffening_power: NDArray[np.float32]
    """(1,) how log a follows what log W of a person has besides the template's: 2 where tissue
    stiffens by its strain, offsets over the thickness of the flesh, and thick flesh is slow."""
    residual: NDArray[np.float32]
    """(P, K, 1) what log W of the P known people has besides, each beside the others: they sum to
    0, for what they share is everybody's."""
    taps: NDArray[np.float32]
    """(N,) shares of f in a step's load, from the newest frame to the oldest; they sum to 1."""

    def powers(self) -> dict[str, float]:
        """By which power of W / W of the template each node field of a person follows; the others
        are everybody's."""
        return {"omega": 1.0, "stiffening": float(self.stiffening_power[0]), "sag": SAG_POWER}


@dataclass(frozen=True, eq=False)
class StaticPart:
    """What offsets have of the pose alone, which no load explains: zero unless data ask for it."""

    constant_m: NDArray[np.float32]
    """(P, V, 3) of each known person."""
    by_pose_m: NDArray[np.float32]
    """(207, K, 3) of the pose features R - I, at the nodes."""

    @classmethod
    def nothing(cls) -> StaticPart:
        """No static part."""
        return cls(np.zeros((0, 0, 3), np.float32), np.zeros((0, 0, 3), np.float32))

    def __bool__(self) -> bool:
        """Whether there is one."""
        return bool(self.constant_m.any() or self.by_pose_m.any())


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """What shapes of another body than the trained one mean: see `dsnet.prediction.transfer`."""

    to_betas: NDArray[np.floating]
    """(S, 10) its betas in the trained body's shape space, up to `shift`."""
    shift: NDArray[np.floating]
    """(10,) its mean person there."""
    template: NDArray[np.float64]
    """(K, 3) `shape_measures` at the nodes that it would have as the trained body's mean person."""


@dataclass(frozen=True, eq=False)
class TrainedPlus:
    """Nodes, weights, the people they were learned from, and the static part."""

    nodes: TissueNodes
    weights: Weights
    static: StaticPart
    people_betas: NDArray[np.float32]
    """(P, 10)."""
    look_ahead: int
    """Frames after that of a step's load that the newest of these lies; 0 needs no later pose."""
    elsewhere: Elsewhere | None = None
    """None on the body that it was trained on."""

    @property
    def beta_count(self) -> int:
        """How many betas its body takes."""
        return N_BETAS if self.elsewhere is None else len(self.elsewhere.to_betas)

    @classmethod
    def load(cls, trained: Artifact) -> TrainedPlus:
        """From a finished `train_plus`."""
        return cls.from_arrays(load_weights(trained.file(f"{NAME}.safetensors")))

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray]) -> TrainedPlus:
        """The inverse of `arrays`."""
        _check_arrays(arrays)
        if (steps := int(arrays["steps"][0])) != STEPS:
            raise _refused(f"{steps} steps a frame", f"{STEPS} steps")
        base = {name: arrays[f"log_{name}"] for name in NODE_FIELDS}
        weights = Weights(base, **{name: arrays[name] for name in _LEARNED})
        static = StaticPart(arrays["constant_m"], arrays["by_pose_m"])
        nodes = TissueNodes.from_arrays(arrays)
        ahead, elsewhere = int(arrays["look_ahead"][0]), None
        if "elsewhere/shift" in arrays:
            names = Elsewhere.__dataclass_fields__
            elsewhere = Elsewhere(**{name: arrays[f"elsewhere/{name}"] for name in names})
        return cls(nodes, weights, static, arrays["people_betas"], ahead, elsewhere)

    def arrays(self) -> dict[str, NDArray]:
        """Everything by name, for a safetensors file."""
        elsewhere = {} if self.elsewhere is None else vars(self.elsewhere)
        return {
            **self.nodes.arrays(),
            **{f"log_{name}": array for name, array in self.weights.base.items()},
            **{name: getattr(self.weights, name) for name in _LEARNED},
            **vars(self.static),
            "people_betas": self.people_betas,
            "look_ahead": np.array([self.look_ahead], np.int32),
            "steps": np.array([STEPS], np.int32),
            **{f"elsewhere/{name}": array for name, array in elsewhere.items()},
        }

    def constant_m(self, betas: NDArray) -> NDArray[np.float32] | None:
        """(V, 3) what a known person (10,), or (T, V, 3) each of T bodies, has in every pose; None
        where nobody has anything."""
        constant_m = self.static.constant_m
        if not constant_m.any():
            return None
        return np.tensordot(known_person(betas, self.people_betas), constant_m, 1)

    def static_m(
        self, body: BodyModelData, betas: NDArray, theta: NDArray
    ) -> NDArray[np.float32] | None:
        """(T, V, 3) the static part of a body (10,) or of T bodies; None where there is none.

        New people have no constant."""
        static = self.static
        if not static:
            return None
        static_m = np.zeros((len(theta), len(self.nodes.owners), 3), np.float32)
        if (constant_m := self.constant_m(betas)) is not None:
            static_m += constant_m
        if static.by_pose_m.any():
            # Other bodies have hands of more joints, which theta has not.
            features = static_features(body, theta)[:, : len(static.by_pose_m)]
            at_nodes = np.tensordot(features, static.by_pose_m, 1)
            static_m += self.nodes.spread(at_nodes)
        return static_m if static_m.any() else None


def static_features(body: BodyModelData, theta: NDArray) -> NDArray[np.floating]:
    """(T, 207) R - I of every joint but the root: smooth, and zero in the rest pose."""
    pose, _ = unpack_theta(np.asarray(theta, np.float64))
    return pose_features(joint_rotations(body, pose)).astype(np.float32)


def shares_of_people(betas: NDArray, people: NDArray) -> NDArray[np.floating]:
    """(P,) by which a body (10,) takes after known people (P, 10): Gaussian kernel regression.

    About 1 for oneself, 0 for everybody far away, where shape alone speaks.
    """
    people = np.asarray(people, np.float64)
    nearness = _kernel(people, np.asarray(betas, np.float64)[None])
    return np.linalg.solve(people_kernel(people), nearness)[:, 0]


def people_kernel(people: NDArray) -> NDArray[np.floating]:
    """(P, P) the regression's matrix of known people (P, 10)."""
    return _kernel(people, people) + _KERNEL_NOISE * np.eye(len(people))


def known_person(betas: NDArray, people: NDArray) -> NDArray[np.floating]:
    """(..., P) 1 for the person of exactly the shape betas (..., 10), else zeros."""
    same = np.isclose(np.asarray(people), np.asarray(betas)[..., None, :], atol=1e-5)
    return np.asarray(same.all(axis=-1), np.float32)


def _kernel(first: NDArray, second: NDArray) -> NDArray[np.floating]:
    squared = np.square(first[:, None] - second[None]).sum(-1)
    return np.exp(-squared / (2 * KERNEL_WIDTH**2))


def _check_arrays(arrays: Mapping[str, NDArray]) -> None:
    """Refuse arrays that are missing, do not fit one another or point outside."""
    sizes: dict[str, int] = {}
    elsewhere = _ELSEWHERE if "elsewhere/shift" in arrays else {}
    for name, axes in (_AXES | elsewhere).items():
        if name not in arrays:
            raise _refused(f"no {name!r}", "all of its arrays")
        shape = arrays[name].shape
        named = zip(axes, shape, strict=False)
        fits = tuple(n if isinstance(n, int) else sizes.setdefault(n, size) for n, size in named)
        if len(shape) != len(axes) or shape != fits or not np.isfinite(arrays[name]).all():
            raise _refused(f"{name!r} of shape {shape}", f"finite numbers of shape {fits}")
    bounds = {f"nodes/{name}": sizes["K"] for name in ("owners", "edges")}
    bounds |= {"nodes/vertices": sizes["V"], "look_ahead": _MOST_FRAMES_AHEAD}
    for name, most in bounds.items():
        array = arrays[name]
        if array.dtype.kind not in "iu" or not array.size or array.min() < 0 or array.max() >= most:
            raise _refused(f"{name!r} that point outside", f"whole numbers of 0 to {most - 1}")


def _refused(received: str, expected: str) -> DsnetError:
    remedy = "Train it again, or copy the file again."
    return DsnetError(f"a file of dsnet_plus with {received}", expected, remedy)
