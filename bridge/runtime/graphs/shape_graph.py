"""What a body's shape says of its tissue, as part of an ONNX graph.

What `bridge.tissue.shape` and `TrainedPlus.mechanics` compute, for a character whose shape is new:
a graph does it once for her.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.runtime.graphs.onnx_values import Value, ValueGraph
from bridge.runtime.graphs.tissue_graph import Person
from bridge.tissue.shape import LEAST_DEPTH_M, shape_measures
from bridge.tissue.trained_plus import KERNEL_WIDTH, TrainedPlus, people_kernel


def person_of(graph: ValueGraph, body: BodyModelData, model: TrainedPlus, betas: Value) -> Person:
    """The tissue of persons of shapes betas (B, 10)."""
    with graph.section("person"):
        vertices_m = _shaped(graph, "vertices", body.v_template, body.shapedirs, betas)
        normals, areas_m2, volume_m3 = _surface(graph, body, model.nodes.vertices, vertices_m)
        heights = vertices_m.gather(np.array([1]), axis=2)  # (B, V, 1)
        height_m = heights.max(1, 2) - heights.min(1, 2)
        stature = volume_m3 / (height_m * height_m * height_m)
        depth_m = _depths(graph, body, vertices_m.gather(model.nodes.vertices, axis=1), betas)
        own = _followed(graph, body, model, [depth_m, areas_m2, stature])
        own = own + _taken_after(graph, model, betas).reshape(0, -1, 1)  # (B, K, 1)
        weights = model.weights
        logs = {name: graph.array(name, weights.base[name]) for name in ("omega", "stiffening")}
        power = float(weights.stiffening_power[0])
        exponents = (logs["omega"] + own, logs["stiffening"] + power * own)
        omega, stiffening = (graph.apply("Exp", e).transpose(0, 2, 1) for e in exponents)
        return Person(omega, stiffening, normals.transpose(0, 2, 1))


def known_people(graph: ValueGraph, model: TrainedPlus, betas: Value) -> Value:
    """(B, P) 1 for the person of exactly this shape, as `known_person`."""
    with graph.section("known"):
        apart = graph.apply("Abs", graph.array("people", model.people_betas) - _beside(betas))
        allowed = 1e-5 + 1e-5 * graph.apply("Abs", _beside(betas))
        far = graph.apply("Cast", apart > allowed, to=1).max(2)
        return (1.0 + -far).reshape(0, -1)


def _beside(betas: Value) -> Value:
    return betas.reshape(0, 1, 10)


def _shaped(
    graph: ValueGraph, name: str, template: NDArray, by_shape: NDArray, betas: Value
) -> Value:
    """(B, N, 3) points that shapes move."""
    kernel = by_shape.reshape(-1, by_shape.shape[-1]).T
    moved = betas @ graph.array(f"{name}_shapes", kernel)
    return (moved + graph.array(name, template.ravel())).reshape(0, -1, 3)


def _surface(
    graph: ValueGraph, body: BodyModelData, nodes: NDArray, vertices_m: Value
) -> tuple[Value, Value, Value]:
    """Normals (B, K, 3) and skin areas (B, K, 1) of nodes, and the volume (B, 1, 1)."""
    corners = [vertices_m.gather(body.faces[:, corner], axis=1) for corner in range(3)]
    first, second, third = corners
    volume = (first * _cross(graph, second, third)).sum(2).sum(1) / 6.0
    of_faces = _cross(graph, second - first, third - first)  # (B, F, 3)
    around = _faces_around(body, nodes)
    padded = graph.apply("Pad", of_faces, graph.integers([0, 0, 0, 0, 1, 0]))
    beside = padded.gather(around.ravel(), axis=1).reshape(0, *around.shape, 3)
    total = beside.sum(2).reshape(0, -1, 3)
    normals = total / graph.apply("Sqrt", (total * total).sum(2))
    areas = graph.apply("Sqrt", (beside * beside).sum(3)).sum(2) / 6.0
    return normals, areas.reshape(0, -1, 1), volume


def _faces_around(body: BodyModelData, nodes: NDArray) -> NDArray[np.int64]:
    """(K, D) faces at each node; where there are fewer, one that there is not."""
    corners = np.argsort(body.faces.ravel(), kind="stable")  # by vertex
    starts, stops = (
        np.searchsorted(body.faces.ravel(), nodes, side, sorter=corners)
        for side in ("left", "right")
    )
    found = [corners[start:stop] // 3 for start, stop in zip(starts, stops, strict=True)]
    around = np.full((len(nodes), max(map(len, found))), len(body.faces))
    for row, faces in zip(around, found, strict=True):
        row[: len(faces)] = faces
    return around


def _cross(graph: ValueGraph, first: Value, second: Value) -> Value:
    ahead, behind = np.array([1, 2, 0]), np.array([2, 0, 1])
    left = first.gather(ahead, axis=2) * second.gather(behind, axis=2)
    return left - first.gather(behind, axis=2) * second.gather(ahead, axis=2)


def _depths(graph: ValueGraph, body: BodyModelData, points_m: Value, betas: Value) -> Value:
    """(B, K, 1) distance of points (B, K, 3) to the nearest bone's axis."""
    by_shape = np.stack([body.J_regressor @ axis for axis in body.shapedirs.transpose(1, 0, 2)], 1)
    joints_m = _shaped(graph, "joints", body.joints, by_shape, betas)
    with_parent = np.flatnonzero(body.parents >= 0)
    begins = joints_m.gather(body.parents[with_parent], axis=1)
    bones = (joints_m.gather(with_parent, axis=1) - begins).reshape(0, 1, -1, 3)
    from_begin = points_m.reshape(0, -1, 1, 3) - begins.reshape(0, 1, -1, 3)  # (B, K, 23, 3)
    along = (from_begin * bones).sum(3) / (bones * bones).sum(3)
    along = graph.apply("Clip", along, 0.0, 1.0)
    away = from_begin - along * bones
    nearest = graph.apply("Sqrt", (away * away).sum(3)).min(2, 3).reshape(0, -1, 1)
    return graph.apply("Max", nearest, LEAST_DEPTH_M)


def _followed(
    graph: ValueGraph, body: BodyModelData, model: TrainedPlus, measures: list[Value]
) -> Value:
    """(B, K, 1) what log w has by `shape_features`."""
    template = shape_measures(body, np.zeros(10), model.nodes.vertices)  # (K, 3)
    parts = [
        float(slope) * graph.apply("Log", measure / graph.array(f"template_{k}", column[:, None]))
        for k, (slope, measure, column) in enumerate(
            zip(model.weights.slopes[:, 0], measures, template.T, strict=True)
        )
    ]
    return parts[0] + parts[1] + parts[2]


def _taken_after(graph: ValueGraph, model: TrainedPlus, betas: Value) -> Value:
    """(B, K) what log w has by `shares_of_people`."""
    people = model.people_betas.astype(np.float64)
    residual = np.linalg.solve(people_kernel(people), model.weights.residual[..., 0])
    apart = graph.array("people", people) - _beside(betas)
    squared = (apart * apart).sum(2).reshape(0, -1)
    nearness = graph.apply("Exp", -1 / (2 * KERNEL_WIDTH**2) * squared)
    return nearness @ graph.array("residual", residual)
