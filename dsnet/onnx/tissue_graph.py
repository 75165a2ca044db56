"""The soft tissue of `dsnet_plus` inside an ONNX graph.

It has the loads, a frame of the oscillators, the static equilibrium, and the constants of a shape,
which a graph computes only when a character's shape is new. `bridge.tissue.oscillators` has the
equations. Nodes are the last axis, (B, 3, K), so that coupling nodes is one matrix product for all
B characters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.paper import FPS, N_BETAS
from bridge.tissue.oscillators import GRAVITY_M_S2, STEPS, SWEEPS, coupling
from bridge.tissue.shape import LEAST_DEPTH_M, ends_of_bones, faces_around, shape_measures
from bridge.tissue.trained_plus import KERNEL_WIDTH, TrainedPlus, people_kernel
from dsnet.onnx.onnx_graph import Graph, Value

_MOST_SWEEPS = 400
"""Sweeps to find the equilibrium; trained models need about sixty."""
_WRITTEN_OUT_SWEEPS = 64
"""Of them, in a graph without control flow."""
_SETTLED_M = 1e-9
"""Largest change in a sweep at which tissue counts as settled."""
_STEP_S = 1 / (STEPS * FPS)


@dataclass(frozen=True, eq=False)
class TissueConstants:
    """Constants of K nodes of B characters that depend on the shape."""

    omega: Value
    """(B, 1, K) natural frequency W, 1/s."""
    stiffening: Value
    """(B, 1, K) a, 1/m^2."""
    sag: Value
    """(B, 1, K) |s|, m."""
    normals: Value
    """(B, 3, K) of the skin, in the rest pose."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Coefficients of a step, (B, 1, K) unless stated; part of the state, by these names."""

    spring: Value
    """dt^2 / 4 times w^2."""
    stiffer: Value
    """dt^2 / 2 times w^2 a, 1/m^2."""
    standing: Value
    """dt^2 / 2 times w^2 a |s|_P^2."""
    drag: Value
    """Z W dt."""
    hung: Value
    """(B, 3, K) 2 s, m."""
    normals: Value
    """(B, 3, K)."""

    @classmethod
    def shapes(cls, nodes: int) -> dict[str, tuple[int, int]]:
        """Shapes of one character's coefficients, by name."""
        wide = ("hung", "normals")
        return {name: (3 if name in wide else 1, nodes) for name in cls.__dataclass_fields__}


class TissueGraph:
    """The mechanics of the nodes in a graph.

    Parameters
    ----------
    coefficients : (K, 1) each, by name, for the template body.
    coupled : (K, K) dt^2 C / 4, see `bridge.tissue.oscillators.coupling`.
    taps : weights of the loads of frames in that of a step, from the newest to the oldest.
    """

    def __init__(
        self,
        graph: Graph,
        coefficients: Mapping[str, NDArray],
        coupled: NDArray,
        taps: Sequence[float],
    ) -> None:
        self._graph, self._taps = graph, list(map(float, taps))
        flat = {name: values[:, 0] for name, values in coefficients.items()}
        bound = np.abs(coupled).sum(1)
        with graph.section("sheet"):
            self._damping, self._inertia_gain, self._gravity_gain = (
                graph.array(name, flat[name])
                for name in ("damping_ratio", "inertia_gain", "gravity_gain")
            )
            self._beyond = graph.array("beyond", flat["normal_ratio"] - 1)
            self._bound = graph.array("bound", bound)
            self._self_coupling = graph.array("own_pull", coupled.diagonal())
            self._pulled = graph.array("pulled", (np.diag(bound) - coupled).T)
            self._gravity = graph.array("gravity", GRAVITY_M_S2[:, None])
            self._down = graph.array("down", np.array([[0.0], [-2.0], [0.0]]))

    @classmethod
    def of(cls, graph: Graph, model: TrainedPlus) -> TissueGraph:
        """The nodes of a trained model."""
        coefficients = {name: np.exp(log) for name, log in model.weights.base.items()}
        coupled = coupling(coefficients, model.nodes.laplacian)
        return cls(graph, coefficients, coupled, model.weights.taps.tolist())

    def load(self, acceleration: Value | None, columns: list[Value]) -> Value:
        """Load (B, 3, K), m/s^2, on nodes with an acceleration (B, 3, K), or None for none.

        `columns` are those of the nodes' rotations R, (B, 3, K) each.
        """
        graph = self._graph
        # The rest frame's component y is column y of R times the vector.
        down = graph.concat([(column * self._gravity).sum(1) for column in columns], 1)
        load = self._gravity_gain * (down - self._gravity)
        if acceleration is None:
            return load
        inertia = graph.concat([(column * acceleration).sum(1) for column in columns], 1)
        return load - self._inertia_gain * inertia

    def smoothed(self, loads: list[Value]) -> Value:
        """The load of a step: the weighted sum of those of frames, the newest first."""
        first, *others = (tap * load for tap, load in zip(self._taps, loads, strict=True))
        for other in others:
            first = first + other
        return first

    def frame(
        self, springs: Springs, now: Value, before: Value, load: Value
    ) -> tuple[Value, Value]:
        """Offsets (B, 3, K) a frame after `now`, and those a step earlier."""
        for _ in range(STEPS):
            before, now = now, self.step(springs, now, before, load)
        return now, before

    def settled(self, springs: Springs, load: Value) -> Value:
        """Offsets (B, 3, K) in equilibrium under a constant load.

        Sweeps as in a step; the strain q that stiffens the springs (`bridge.tissue.oscillators`) is
        updated by Newton's method.
        """
        pull, zero = _STEP_S**2 / 4 * load, 0.0 * load
        hung = self._stretched(springs.hung, springs) / 4.0

        def sweep(offset_m: Value, strain: Value) -> tuple[Value, list[Value]]:
            gained = springs.stiffer * strain
            spring = springs.spring + (springs.standing + gained) / 2.0
            left = pull + offset_m @ self._pulled - gained * hung
            new_m = self._solved(left, self._bound + spring, self._beyond * spring, springs)
            reached = self._strain(new_m, self._stretched(new_m, springs), springs)
            slope = (springs.standing + springs.stiffer * reached) / (spring + self._self_coupling)
            new_strain = strain + (reached - strain) / (1.0 + slope)
            change = self._graph.apply("Abs", new_m - offset_m).max(0, 1, 2)
            return (change.reshape() > _SETTLED_M), [new_m, new_strain]

        start = [zero, zero.part(1, 0, 1)]
        return self._graph.repeat(_MOST_SWEEPS, start, sweep, _WRITTEN_OUT_SWEEPS)[0]

    def springs(self, constants: TissueConstants) -> Springs:
        """Coefficients of a step, which depend on the shape alone."""
        down = constants.normals.part(1, 1, 2)
        hanging = constants.sag * constants.sag * (1.0 + self._beyond * down * down)
        taut = constants.stiffening * hanging
        spring = _STEP_S**2 / 4 * constants.omega * constants.omega / (1.0 + 3.0 * taut)
        drag = _STEP_S * constants.omega * self._damping
        hung = self._down * constants.sag
        stiffer, standing = 2.0 * spring * constants.stiffening, 2.0 * spring * taut
        return Springs(spring, stiffer, standing, drag, hung, constants.normals)

    def step(self, springs: Springs, now: Value, before: Value, load: Value) -> Value:
        """Offsets (B, 3, K) a step after `now`, which followed `before`."""
        gained = springs.stiffer * self._strain(now, self._stretched(now, springs), springs)
        stiffer = springs.standing + gained
        twice, after = 2.0 * now + before, 2.0 * now - before
        right = _STEP_S**2 * load + after + springs.drag * before
        sheared = springs.spring * twice + stiffer * before + gained * springs.hung
        right = right - self._stretched(sheared, springs)
        right = right + twice @ self._pulled - self._bound * twice
        held = springs.spring + stiffer
        along = 1.0 + springs.drag + self._bound + held
        beyond = self._beyond * held
        for _ in range(SWEEPS):
            after = self._solved(right + after @ self._pulled, along, beyond, springs)
        return after

    def _strain(self, offsets_m: Value, stretched: Value, springs: Springs) -> Value:
        """The strain q = |v|_P^2 - |s|_P^2, from u and P u."""
        return ((offsets_m + springs.hung) * stretched).sum(1)

    def _stretched(self, offsets_m: Value, springs: Springs) -> Value:
        """P u."""
        outward = (offsets_m * springs.normals).sum(1)
        return offsets_m + self._beyond * outward * springs.normals

    def _solved(self, left: Value, along: Value, beyond: Value, springs: Springs) -> Value:
        """Each node's block, `along` I + `beyond` n n^T, inverted on `left`."""
        outward = (left * springs.normals).sum(1) * beyond / (along + beyond)
        return (left - outward * springs.normals) / along


def tissue_constants(
    graph: Graph, body: BodyModelData, model: TrainedPlus, betas: Value
) -> TissueConstants:
    """The tissue of characters with betas (B, 10)."""
    nodes, weights = model.nodes.vertices, model.weights
    with graph.section("person"):
        vertices_m = _shaped(graph, "vertices", body.v_template, body.shapedirs, betas)
        normals, areas_m2, volume_m3 = _surface(graph, body, nodes, vertices_m)
        heights = vertices_m.gather(np.array([1]), axis=2)  # (B, V, 1)
        height_m = heights.max(1, 2) - heights.min(1, 2)
        stature = volume_m3 / (height_m * height_m * height_m)
        depth_m = _depths(graph, body, vertices_m.gather(nodes, axis=1), betas)
        # Deviation of log W from the template's: by `shape_features`, and by `shares_of_people`.
        if model.elsewhere is None:
            template = shape_measures(body, np.zeros(body.shapedirs.shape[-1]), nodes)  # (K, 3)
        else:
            template = model.elsewhere.template
        depth, girth, mass = (
            float(slope) * graph.apply("Log", measure / graph.array(f"template_{k}", column))
            for k, (slope, measure, column) in enumerate(
                zip(weights.slopes[:, 0], (depth_m, areas_m2, stature), template.T[..., None],
                    strict=True)
            )
        )  # fmt: skip
        deviation = depth + girth + mass + _residual(graph, model, betas).reshape(0, -1, 1)
        logs = {n: graph.array(n, weights.base[n]) + power * deviation
                for n, power in weights.powers().items()}  # fmt: skip
        constants = {n: graph.apply("Exp", log).transpose(0, 2, 1) for n, log in logs.items()}
        return TissueConstants(**constants, normals=normals.transpose(0, 2, 1))


def training_people(graph: Graph, model: TrainedPlus, betas: Value) -> Value:
    """(B, P) 1 for the person of training with exactly these betas, as `known_person`."""
    with graph.section("known"):
        trained = _trained_betas(graph, model, betas).reshape(0, 1, N_BETAS)
        apart = graph.apply("Abs", graph.array("people", model.people_betas) - trained)
        allowed = 1e-5 + 1e-5 * graph.apply("Abs", trained)
        far = graph.apply("Cast", apart > allowed, to=1).max(2)
        return (1.0 + -far).reshape(0, -1)


def _shaped(graph: Graph, name: str, template: NDArray, by_shape: NDArray, betas: Value) -> Value:
    """Points (B, N, 3) of a template (N, 3) that depend on the betas."""
    kernel = by_shape.reshape(-1, by_shape.shape[-1]).T
    displaced = betas @ graph.array(f"{name}_shapes", kernel)
    return (displaced + graph.array(name, template.ravel())).reshape(0, -1, 3)


def _surface(
    graph: Graph, body: BodyModelData, nodes: NDArray, vertices_m: Value
) -> tuple[Value, Value, Value]:
    """Normals (B, K, 3) and skin areas (B, K, 1) of nodes, and the volume (B, 1, 1)."""
    first, second, third = (vertices_m.gather(body.faces[:, k], axis=1) for k in range(3))
    volume = (first * _cross(second, third)).sum(2).sum(1) / 6.0
    of_faces = _cross(second - first, third - first)  # (B, F, 3)
    around = faces_around(body, nodes)
    padded = graph.apply("Pad", of_faces, graph.integers([0, 0, 0, 0, 1, 0]))
    adjacent = padded.gather(around.ravel(), axis=1).reshape(0, *around.shape, 3)
    total = adjacent.sum(2).reshape(0, -1, 3)
    normals = total / graph.apply("Sqrt", (total * total).sum(2))
    areas = graph.apply("Sqrt", (adjacent * adjacent).sum(3)).sum(2) / 6.0
    return normals, areas.reshape(0, -1, 1), volume


def _cross(first: Value, second: Value) -> Value:
    ahead, behind = np.array([1, 2, 0]), np.array([2, 0, 1])
    left = first.gather(ahead, axis=2) * second.gather(behind, axis=2)
    return left - first.gather(behind, axis=2) * second.gather(ahead, axis=2)


def _depths(graph: Graph, body: BodyModelData, points_m: Value, betas: Value) -> Value:
    """Distances (B, K, 1) of points (B, K, 3) from the nearest bone's axis."""
    joints_m = _shaped(graph, "joints", body.joints, body.joint_shapes, betas)
    with_parent = ends_of_bones(body.joints, body.parents)
    begins = joints_m.gather(body.parents[with_parent], axis=1)
    bones = (joints_m.gather(with_parent, axis=1) - begins).reshape(0, 1, -1, 3)
    from_begin = points_m.reshape(0, -1, 1, 3) - begins.reshape(0, 1, -1, 3)  # (B, K, 23, 3)
    along = ((from_begin * bones).sum(3) / (bones * bones).sum(3)).clip(0.0, 1.0)
    away = from_begin - along * bones
    nearest = graph.apply("Sqrt", (away * away).sum(3)).min(2, 3).reshape(0, -1, 1)
    return graph.apply("Max", nearest, LEAST_DEPTH_M)


def _trained_betas(graph: Graph, model: TrainedPlus, betas: Value) -> Value:
    """Betas (B, 10) in the shape space of the body that the model was trained on."""
    transfer = model.elsewhere
    if transfer is None:
        return betas
    return betas @ graph.array("to_betas", transfer.to_betas) + graph.array("shift", transfer.shift)


def _residual(graph: Graph, model: TrainedPlus, betas: Value) -> Value:
    """Deviation (B, K) of log W by `shares_of_people`."""
    people = model.people_betas.astype(np.float64)
    residual = np.linalg.solve(people_kernel(people), model.weights.residual[..., 0])
    apart = graph.array("people", people) - _trained_betas(graph, model, betas).reshape(
        0, 1, N_BETAS
    )
    squared = (apart * apart).sum(2).reshape(0, -1)
    nearness = graph.apply("Exp", -1 / (2 * KERNEL_WIDTH**2) * squared)
    return nearness @ graph.array("residual", residual)
