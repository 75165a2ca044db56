"""A trained `dsnet_plus` on another body, of any number and order of vertices, open or in pieces.

The trained body A is brought to the other, B: its shape space is fitted to B's template, its limbs
turn as B's lie, and each node goes to the vertex of B that is nearest then. What is of the surface
is B's: how nodes share vertices, areas, what pulls between nodes. A node's constants go with
it, so they are functions of the place on the body. Betas of B become betas in
A's shape space by an affine map, so that the trained people, and the mean person whom shapes are
compared with, stay who they are. No vertex number of one body means anything on the other.

The same surface, whatever its numbering, comes back as the same nodes: tests hold it to that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from bridge.body import BodyModelData
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import shaped_vertices
from bridge.body.surface_operators import vertex_areas_m2, vertex_normals
from bridge.motion.directions import shortest_turn
from bridge.paper import N_JOINTS
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.shape import shape_measures
from bridge.tissue.trained_plus import Elsewhere, StaticPart, TrainedPlus

_LIMBS = {"hip": ("knee",), "knee": ("ankle", "foot"), "shoulder": ("elbow",), "elbow": ("wrist",)}
"""Joints whose bone is long enough to show how a limb lies, to the joint where it ends; behind
which others turn as it does."""
_ROUNDS = 30
_SAMPLES = 2500
"""Vertices of the trained body that are brought to the other."""
_LEAST_M = 1e-4
"""Of what is taken for usual between two bodies: how far places are off the skin, and joints beside
their likes. The better the bodies agree, the less it costs to be no mean person."""
_ALIKE = 50.0
"""Neighbouring vertices that are alike."""
_FACING = 0.5
"""Least cosine between normals of places that are the same."""
_NORMAL_M = 0.05
"""In a search for the nearest place, what a normal that points another way counts."""
_LEAST_SINGULAR = 0.05
"""Of the largest singular value of the map of shapes: smaller ones are taken as zero."""
_FARTHEST_BETA = 3.0
_LEAST_PIECE = 0.02
"""Of a body's area: a smaller piece, such as an eyeball, has no flesh."""


def carried(model: TrainedPlus, trained_on: BodyModelData, body: BodyModelData) -> TrainedPlus:
    """The model on another body. What single people have that no load explains stays behind."""
    skin = flesh_vertices(body)
    fitted = _Fitted(trained_on, body, skin)
    vertices, kept = fitted.nodes(model.nodes.vertices)
    weights = replace(
        model.weights,
        base={name: log[kept] for name, log in model.weights.base.items()},
        residual=model.weights.residual[:, kept],
    )
    to_betas, shift = fitted.betas_map()
    mean = _mean_person(to_betas, shift)
    trained_measures, mean_measures = (
        shape_measures(trained_on, betas, model.nodes.vertices[kept])
        for betas in (np.zeros_like(shift), mean @ to_betas + shift)
    )
    shaped = replace(body, v_template=body.v_template + body.shapedirs @ mean)
    return TrainedPlus(
        TissueNodes.at(shaped, vertices, skin),
        weights,
        StaticPart(np.zeros((0, 0, 3), np.float32), model.static.by_pose_m[:, kept]),
        model.people_betas,
        model.look_ahead,
        Elsewhere(
            to_betas, shift, shape_measures(body, mean, vertices) * trained_measures / mean_measures
        ),
    )


def _mean_person(to_betas: NDArray, shift: NDArray) -> NDArray[np.float64]:
    """(S,) betas of a body that make it the trained one's mean person, whose surface carries the
    nodes of all people; not more than a person's."""
    mean = np.linalg.lstsq(to_betas.T, -shift, rcond=_LEAST_SINGULAR)[0]
    return mean * min(1.0, _FARTHEST_BETA / max(float(np.abs(mean).max()), 1e-9))


def flesh_vertices(body: BodyModelData) -> NDArray[np.int64]:
    """Vertices of the pieces that are large enough to be skin."""
    faces, count = body.faces, body.vertex_count
    links = sp.coo_matrix((np.ones(faces.size), (faces.ravel(), np.roll(faces, 1, 1).ravel())),
                          shape=(count, count))  # fmt: skip
    _, piece = connected_components(links, directed=False)
    area_m2 = np.bincount(piece, vertex_areas_m2(body.v_template, faces))
    return np.flatnonzero((area_m2 > _LEAST_PIECE * area_m2.sum())[piece])


class _Fitted:
    """The trained body in the shape and the pose of another's template."""

    def __init__(self, body: BodyModelData, other: BodyModelData, skin: NDArray) -> None:
        self._body, self._other, self._skin = body, other, skin
        self._frame = _Frame.of(body)
        self._others_joints = other.joints[:N_JOINTS]
        self._by_shape, self._others_by_shape = (
            one.joint_shapes[:N_JOINTS] for one in (body, other)
        )
        normals = vertex_normals(other.v_template, other.faces)[skin]
        self._surface, self._normals = other.v_template[skin], normals
        self._tree = KDTree(np.hstack([self._surface, _NORMAL_M * normals]))
        self._sample = np.unique(np.linspace(0, body.vertex_count - 1, _SAMPLES).astype(int))
        self.betas = np.zeros(body.shapedirs.shape[-1])
        for _ in range(_ROUNDS):
            step = self._step()
            self.betas = self.betas + step
            if np.abs(step).max() < 1e-6:
                break

    def _step(self) -> NDArray[np.floating]:
        """What brings the shape closer: distances to the other's surface along its normals, and
        between joints about the trunk."""
        places, normals = self._brought()
        near, facing = self._nearest(places[self._sample], normals[self._sample])
        apart = self._surface[near] - places[self._sample]
        by_shape = self._brought_directions(self._sample)
        along = (self._normals[near][..., None] * by_shape).sum(1)
        off = (self._normals[near] * apart).sum(1)
        bones, bones_by_shape = self._bones()
        hessian, wanted = _ALIKE * np.eye(len(self.betas)), -_ALIKE * self.betas
        for by_beta, apart_m, here in ((along, off, facing), (bones_by_shape, bones, 1.0)):
            usual_m = max(1.5 * float(np.median(np.abs(apart_m))), _LEAST_M)
            # Less of hair, of hands that are held otherwise, of joints that are others.
            trust = here / usual_m**2 / np.maximum(np.abs(apart_m) / (2 * usual_m), 1)
            hessian = hessian + by_beta.T @ (trust[:, None] * by_beta)
            wanted = wanted + by_beta.T @ (trust * apart_m)
        return np.linalg.solve(hessian, wanted)

    def _trained(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Vertices (V, 3) and joints (22, 3) of the trained body in its shape."""
        vertices = shaped_vertices(self._body, self.betas[None])[0]
        return vertices, (self._body.J_regressor @ vertices)[:N_JOINTS]

    def _bones(self) -> tuple[NDArray, NDArray]:
        """Joints apart (66,), metres, and what betas do (66, B), about the trunk."""
        _, joints = self._trained()
        apart = self._frame.about_trunk(self._others_joints) - self._frame.about_trunk(joints)
        return apart.ravel(), self._frame.about_trunk(self._by_shape).reshape(apart.size, -1)

    def _brought(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Vertices (V, 3) of the trained body where the other's template has them, and normals."""
        vertices, joints = self._trained()
        turns = self._frame.turns(joints, self._others_joints)
        places = self._frame.moved(vertices, joints, self._others_joints, turns)
        return places, vertex_normals(places, self._body.faces)

    def _brought_directions(self, rows: NDArray) -> NDArray[np.float64]:
        """(N, 3, B) what betas of the trained body do there, about limbs and trunk."""
        turns = self._frame.turns(self._trained()[1], self._others_joints)
        still = np.zeros_like(self._by_shape)
        return self._frame.moved(self._body.shapedirs[rows], self._by_shape, still, turns, rows)

    def _nearest(self, places: NDArray, normals: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
        _, near = self._tree.query(np.hstack([places, _NORMAL_M * normals]))
        near = np.asarray(near)
        return near, (self._normals[near] * normals).sum(1) > _FACING

    def nodes(self, vertices: NDArray) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
        """Where nodes at some vertices of the trained body go, and which of them: no two to the
        same."""
        places, normals = self._brought()
        near, facing = self._nearest(places[vertices], normals[vertices])
        far = np.linalg.norm(self._surface[near] - places[vertices], axis=1) + ~facing
        order = np.argsort(far, kind="stable")
        _, first = np.unique(near[order], return_index=True)
        kept = np.sort(order[first])
        return self._skin[near[kept]].astype(np.int32), kept

    def betas_map(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """(S, B) and (B,): betas of the other body as betas of the trained one."""
        places, normals = self._brought()
        near, facing = self._nearest(places[self._sample], normals[self._sample])
        rows, near = self._sample[facing], near[facing]
        facing_out = self._normals[near][..., None]
        ours = (facing_out * self._brought_directions(rows)).sum(1)
        still, turns = np.zeros((N_JOINTS, 3, 1)), np.eye(3)[None].repeat(N_JOINTS, 0)
        others = self._frame.moved(
            self._other.shapedirs[self._skin[near]], self._others_by_shape, still, turns, rows,
        )  # fmt: skip
        theirs = (facing_out * others).sum(1)
        _, bones = self._bones()
        theirs_bones = self._frame.about_trunk(self._others_by_shape)
        system = np.concatenate([ours, bones])
        wanted = np.concatenate([theirs, theirs_bones.reshape(len(bones), -1)])
        return np.linalg.lstsq(system, wanted, rcond=None)[0].T, self.betas


@dataclass(frozen=True, eq=False)
class _Frame:
    """How the parts of a body go where another's are: limbs about their joints, the rest with the
    trunk, which models place alike up to a shift, whatever they call its joints."""

    weights: NDArray[np.float64]
    """(V, 22) of the bones that move vertices."""
    limb_of: Sequence[int]
    """The joint that each of 22 turns about, -1 of the trunk."""
    ends: dict[int, int]
    """The joint where each limb's bone ends."""

    @classmethod
    def of(cls, body: BodyModelData) -> _Frame:
        index = {name: number for number, name in enumerate(SMPL_JOINT_NAMES[:N_JOINTS])}
        limb_of, ends = [-1] * N_JOINTS, {}
        for side in ("left", "right"):
            for joint, behind in _LIMBS.items():
                limb = index[f"{side}_{joint}"]
                ends[limb] = index[f"{side}_{behind[0]}"]
                for name in (joint, *behind):
                    if limb_of[index[f"{side}_{name}"]] < 0 or name == joint:
                        limb_of[index[f"{side}_{name}"]] = limb
        weights = body.body_weights
        return cls(weights / weights.sum(1, keepdims=True), limb_of, ends)

    def turns(self, joints: NDArray, others: NDArray) -> NDArray[np.float64]:
        """(22, 3, 3) what turns each bone of joints (22, 3) the short way to the others'."""
        turns = np.eye(3)[None].repeat(N_JOINTS, 0)
        for joint, limb in enumerate(self.limb_of):
            if limb >= 0:
                bones = (at[self.ends[limb]] - at[limb] for at in (joints, others))
                turns[joint] = shortest_turn(*bones)
        return turns

    def about_trunk(self, joints: NDArray) -> NDArray[np.float64]:
        """Joints (22, 3, ...) about the middle of the trunk's."""
        return joints - joints[self._trunk].mean(0)

    @property
    def _trunk(self) -> NDArray[np.bool_]:
        return np.array(self.limb_of) < 0

    def moved(
        self,
        places: NDArray,
        joints: NDArray,
        others: NDArray,
        turns: NDArray,
        rows: NDArray | None = None,
    ) -> NDArray[np.float64]:
        """Places (N, 3, ...) about joints (22, 3, ...), about the others' joints."""
        begins, ends = (
            np.stack([at[limb] if limb >= 0 else at[self._trunk].mean(0) for limb in self.limb_of])
            for at in (joints, others)
        )
        weights = self.weights if rows is None else self.weights[rows]
        shifts = ends - np.einsum("jxy,jy...->jx...", turns, begins)
        turned = np.einsum("nj,jxy->nxy", weights, turns)
        blended = np.tensordot(weights, shifts, 1)
        return np.einsum("nxy,ny...->nx...", turned, places) + blended
