"""What of a body's shape matters to its tissue: how soft it is where, and which way is out."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.body.posing import shaped_joints, shaped_vertices
from bridge.body.surface_operators import vertex_areas_m2, vertex_normals, volume_m3

SHAPE_FEATURES = ("depth", "girth", "mass")
LEAST_DEPTH_M = 0.01
"""Of a node that lies nearer to a bone's axis: a depth has a logarithm."""


def shape_features(body: BodyModelData, betas: NDArray, nodes: NDArray) -> NDArray[np.float32]:
    """(K, 3) logarithms, relative to the template's body, of

    - depth: the distance of the node to the nearest bone's axis,
    - girth: the skin's area about it, which grows with the limb's girth,
    - mass: the whole body's volume over the cube of its height.

    Parameters
    ----------
    betas : (10,) shape.
    nodes : (K,) vertices.
    """
    person, template = (shape_measures(body, b, nodes) for b in (betas, np.zeros_like(betas)))
    return np.log(person / template).astype(np.float32)


def shaped_normals(body: BodyModelData, betas: NDArray) -> NDArray[np.float32]:
    """(V, 3) outward normals of the body of shape betas (10,) in the rest pose."""
    vertices = shaped_vertices(body, np.asarray(betas, np.float64)[None])[0]
    return vertex_normals(vertices, body.faces).astype(np.float32)


def shape_measures(body: BodyModelData, betas: NDArray, nodes: NDArray) -> NDArray[np.floating]:
    """(K, 3) what `shape_features` compares: metres, square metres, and a ratio."""
    shape = np.asarray(betas, np.float64)[None]
    vertices, joints = shaped_vertices(body, shape)[0], shaped_joints(body, shape)[0]
    depth_m = np.maximum(distance_to_bones_m(vertices[nodes], joints, body.parents), LEAST_DEPTH_M)
    area_m2 = vertex_areas_m2(vertices, body.faces)[nodes]
    stature = volume_m3(vertices, body.faces) / np.ptp(vertices[:, 1]) ** 3
    return np.stack([depth_m, area_m2, np.full(len(nodes), stature)], axis=1)


def distance_to_bones_m(points: NDArray, joints: NDArray, parents: NDArray) -> NDArray[np.floating]:
    """(N,) distance of points (N, 3) to the nearest line from a joint (J, 3) to its parent."""
    nearest = np.full(len(points), np.inf)
    for joint in ends_of_bones(joints, parents):
        begin = joints[parents[joint]]
        bone = joints[joint] - begin
        along = np.clip((points - begin) @ bone / (bone @ bone), 0.0, 1.0)
        away = points - begin - along[:, None] * bone
        nearest = np.minimum(nearest, np.linalg.norm(away, axis=1))
    return nearest


def ends_of_bones(joints: NDArray, parents: NDArray) -> NDArray[np.intp]:
    """Which joints (J, 3) do not lie where their parents do, as some models' eyes and fingers."""
    apart = np.linalg.norm(joints - joints[parents], axis=1)
    return np.flatnonzero((parents >= 0) & (apart > 1e-6))


def faces_around(body: BodyModelData, nodes: NDArray) -> NDArray[np.int64]:
    """Faces (K, D) at each of some vertices (K,), filled up with the index after the last face."""
    corners = body.faces.ravel()
    ends = np.cumsum(np.bincount(corners, minlength=body.vertex_count))
    of_vertices = np.split(np.argsort(corners, kind="stable") // 3, ends[:-1])
    columns = zip_longest(*(of_vertices[node] for node in nodes), fillvalue=len(body.faces))
    return np.array([*columns]).T
