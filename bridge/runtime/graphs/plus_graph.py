"""`dsnet_plus` as one ONNX graph: a pose in, the posed skin with its tissue out.

Inputs `theta` (B, 69), `betas` (B, 10) and `state` (B, S); outputs `vertices` (B, V, 3), metres,
and `next_state` (B, S). A character whose row of the state is zero has no past: she begins settled
in the pose that she is given, which costs a few tens of milliseconds in that frame and nothing in
later ones (`If` and `Loop`). So does one whose betas are others than a frame before. A row is all
that is known of a character: rows may be added, removed and reordered from frame to frame.

Vertices are `latency_frames` old, pose and place included, as the model looks so far ahead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import onnx

from bridge.body import BodyModelData
from bridge.paper import N_BETAS, THETA_SIZE
from bridge.runtime.graphs.body_graph import surface, turned
from bridge.runtime.graphs.bones_graph import (
    BONES,
    TURNING,
    PosedBones,
    posed_bones,
    translated,
    translation,
)
from bridge.runtime.graphs.onnx_kernels import Precision
from bridge.runtime.graphs.onnx_values import Value, ValueGraph
from bridge.runtime.graphs.shape_graph import known_people, person_of
from bridge.runtime.graphs.state_layout import StateLayout
from bridge.runtime.graphs.tissue_graph import Person, SheetGraph
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.oscillators import FPS, coupling
from bridge.tissue.trained_plus import TrainedPlus

_BLOCK = 106
"""Vertices that follow one another, whose offsets are one matrix product of the nodes near them:
numbering follows the surface, so these are few. 65 blocks are SMPL's 6890 vertices."""
Arrays = dict[str, Value]


def plus_layout(model: TrainedPlus) -> StateLayout:
    """What a character's row holds; K nodes, N taps, P known people, L frames of latency."""
    nodes = len(model.nodes)
    shapes: dict[str, tuple[int, ...]] = {
        "age": (1,),
        "betas": (N_BETAS,),
        "omega": (1, nodes),
        "stiffening": (1, nodes),
        "normals": (3, nodes),
        "known": (len(model.people_betas),),
        "now": (3, nodes),
        "before": (3, nodes),
        "places": (3, nodes),
        "moves": (3, nodes),
        "turns": (9, nodes),
        "trans": (3,),
        "felt": (len(model.weights.taps) - 1, 3, nodes),
        "late_bones": (model.look_ahead, 12, BONES),
        "late_features": (model.look_ahead, TURNING),
        "late_trans": (model.look_ahead, 3),
    }
    return StateLayout({name: shape for name, shape in shapes.items() if np.prod(shape)})


def step_layout(model: TrainedPlus) -> StateLayout:
    """The same without what only the skin must know."""
    shapes = plus_layout(model).shapes
    skins = ("known", "late_")
    return StateLayout({n: shape for n, shape in shapes.items() if not n.startswith(skins)})


def plus_step_graph(model: TrainedPlus, body: BodyModelData) -> onnx.ModelProto:
    """The step of a trained `dsnet_plus` alone: outputs `codes` (B, 3, K), offsets of the nodes in
    the rest pose, metres, `look_ahead` frames ago, and `next_state`."""
    step = _PlusStep(model, body, step_layout(model))
    return step.graph.model(
        "dsnet_plus_step",
        {"codes": step.codes, "next_state": step.layout.written(step.graph, step.after)},
        {"codes": ("B", 3, len(model.nodes)), "next_state": ("B", step.layout.size)},
        checked=False,
    )


def plus_graph(
    model: TrainedPlus,
    body: BodyModelData,
    metadata: Mapping[str, str] | None = None,
    precision: Precision = "float32",
) -> onnx.ModelProto:
    """The same step and the skin, on the body model that a `dsnet_plus` was trained with.

    Of its kernels only the pose blend shapes are large; `precision` is theirs.
    """
    step = _PlusStep(model, body, plus_layout(model))
    vertices, late = _Skin(step, precision).shown()
    return step.graph.model(
        "dsnet_plus",
        {"vertices": vertices, "next_state": step.layout.written(step.graph, step.after | late)},
        {"vertices": ("B", body.vertex_count, 3), "next_state": ("B", step.layout.size)},
        {
            **(metadata or {}),
            "latency_frames": str(model.look_ahead),
            "state_layout": step.layout.as_text(),
        },
    )


class _PlusStep:
    """One frame of B characters: what it was, `past`, what it is, `present`, and what follows."""

    def __init__(self, model: TrainedPlus, body: BodyModelData, layout: StateLayout) -> None:
        self.model, self.body, self.layout = model, body, layout
        self.graph = graph = ValueGraph()
        coefficients = {name: np.exp(log) for name, log in model.weights.base.items()}
        coupled = coupling(coefficients, model.nodes.laplacian)
        self._sheet = SheetGraph(graph, coefficients, coupled, model.weights.taps.tolist())
        theta = graph.input("theta", ("B", THETA_SIZE))
        self.betas = graph.input("betas", ("B", N_BETAS))
        state = graph.input("state", ("B", layout.size))
        bones = posed_bones(graph, body, theta, self.betas)
        self.present = self._present(bones, theta, self.betas)
        self.past = layout.read(self._with_past(state, self.betas, self.present))
        with graph.section("load"):
            after, felt = self._felt(self.past, self.present)
        with graph.section("oscillators"):
            past = self.past
            person = Person(past["omega"], past["stiffening"], past["normals"])
            load = self._sheet.smoothed(felt)
            now, before = self._sheet.frame(person, past["now"], past["before"], load)
            now, before = self._from_the_first_frame_on(past, now, before)
        self.codes = now
        self.after: Arrays = past | after | {"now": now, "before": before}

    def _present(self, bones: PosedBones, theta: Value, betas: Value) -> Arrays:
        """Of this frame: places of the nodes about the root, turns, bones."""
        graph = self.graph
        with graph.section("nodes"):
            nodes = surface(graph, self.body, self.model.nodes.vertices)
            blended = self._as_if_whole(bones.bones @ nodes.weights)
            *columns, shift = blended.split(1, [3, 3, 3, 3])
            rest = nodes.rest(bones.features, betas)
            return {
                "places": turned(columns, shift, rest, axis=1),
                "turns": graph.concat(columns, 1),
                "trans": translation(theta),
                "bones": bones.bones,
                "features": bones.features,
            }

    def _as_if_whole(self, blended: Value) -> Value:
        """What weights that sum to 1 would give: then standing is no turn, and no load."""
        missing = 1 - self.body.weights[self.model.nodes.vertices].sum(axis=1)
        still = np.append(np.eye(3).ravel(), np.zeros(3))[:, None]
        return blended + self.graph.array("missing", still * missing)

    def _with_past(self, state: Value, betas: Value, present: Arrays) -> Value:
        """The state, where those without a past have been given one."""
        graph = self.graph
        with graph.section("past"):
            age, betas_before = state.part(1, 0, 1), state.part(1, 1, 1 + N_BETAS)
            apart = graph.apply("Abs", betas - betas_before).max(1)
            new = graph.apply("Max", apart, 1.0 + -age) > 0.0  # (B, 1)
            count = graph.apply("Cast", new, to=1).max(0, 1).reshape()

            def begun() -> Value:
                rows = graph.apply("NonZero", new.reshape(-1))
                mine = {name: _rows(value, rows) for name, value in present.items()}
                fresh = self._begun(_rows(betas, rows), mine)
                return graph.apply("ScatterND", state, rows.transpose(1, 0), fresh)

            return graph.choose(count > 0.0, begun, lambda: state)

    def _begun(self, betas: Value, present: Arrays) -> Value:
        """Rows of those who have stood in the present pose for ever."""
        graph = self.graph
        person = person_of(graph, self.body, self.model, betas)
        with graph.section("settled"):
            felt = self._sheet.felt(None, present["turns"].split(1, [3, 3, 3]))
            offsets_m = self._sheet.settled(person, felt)
            nothing = 0.0 * present["trans"]
            begun = {
                "age": nothing.part(1, 0, 1),
                "betas": betas,
                "omega": person.omega,
                "stiffening": person.stiffening,
                "normals": person.normals,
                "now": offsets_m,
                "before": offsets_m,
                "places": present["places"],
                "moves": 0.0 * offsets_m,
                "turns": present["turns"],
                "trans": present["trans"],
                "felt": graph.concat([felt] * max(len(self.model.weights.taps) - 1, 1), 1),
            }
            if "known" in self.layout.shapes:
                begun["known"] = known_people(graph, self.model, betas)
            frames = max(self.model.look_ahead, 1)
            for name in ("bones", "features", "trans"):
                begun[f"late_{name}"] = graph.concat([_long(present[name])] * frames, 1)
            return self.layout.written(graph, begun)

    def _felt(self, past: Arrays, present: Arrays) -> tuple[Arrays, list[Value]]:
        """What the next frame must know, and loads, the newest first: of the frame before this.

        Places are about the root, whose own way is differenced apart: far from the origin a sum
        of both would have lost the digits that accelerations are made of. What moves in her first
        frame moved before it too, as in whole clips, so that frame has no acceleration.
        """
        graph, (nodes, count) = self.graph, (len(self.model.nodes), len(self.model.weights.taps))
        steps = (present["trans"] - past["trans"]).reshape(0, 3, 1)
        moves = (present["places"] - past["places"]) + steps
        young = past["age"].reshape(0, 1, 1)  # 0, 1, then what has an acceleration
        counts = FPS**2 * graph.apply("Min", graph.apply("Max", young - 1.0, 0.0), 1.0)
        acceleration = counts * (moves - past["moves"])
        age = graph.apply("Min", past["age"] + 1.0, float(max(2, self.model.look_ahead + 1)))
        newest = self._sheet.felt(acceleration, past["turns"].split(1, [3, 3, 3]))
        loads = [newest]
        if count > 1:
            older = past["felt"].reshape(0, 3 * (count - 1), nodes)
            loads += older.split(1, [3] * (count - 1))
        after = {name: present[name] for name in ("places", "turns", "trans")}
        kept = {"felt": graph.concat(loads[: count - 1], 1)} if count > 1 else {}
        return {**after, "age": age, "moves": moves, **kept}, loads

    def _from_the_first_frame_on(
        self, past: Arrays, now: Value, before: Value
    ) -> tuple[Value, Value]:
        """Offsets that rest until the first frame is shown: loads are known so much earlier."""
        frames, graph = self.model.look_ahead, self.graph
        if frames < 2:  # the loads of rest are all that was known
            return now, before
        going = graph.apply("Min", graph.apply("Max", past["age"] + -float(frames), 0.0), 1.0)
        going = going.reshape(0, 1, 1)
        held, held_before = past["now"], past["before"]
        return held + going * (now - held), held_before + going * (before - held_before)


class _Skin:
    """The posed surface of the step's characters, as late as their offsets are."""

    def __init__(self, step: _PlusStep, precision: Precision) -> None:
        self._step, self._graph, self._model = step, step.graph, step.model
        self._precision: Precision = precision

    def shown(self) -> tuple[Value, Arrays]:
        """(B, V, 3) vertices, and what the next frame must know of later ones."""
        shown, late = self._shown(self._step.past, self._step.present)
        return self._vertices(shown), late

    def _shown(self, past: Arrays, present: Arrays) -> tuple[Arrays, Arrays]:
        """The pose that is shown, and what the next frame must know of later ones."""
        frames, names = self._model.look_ahead, ("bones", "features", "trans")
        if frames == 0:
            return {name: present[name] for name in names}, {}
        shown, late = {}, {}
        for name in names:
            whole = past[f"late_{name}"]
            oldest, *others = whole.split(1, [1] * frames)
            shape = self._step.layout.shapes[f"late_{name}"][1:]
            shown[name] = oldest.reshape(0, *shape)
            late[f"late_{name}"] = self._graph.concat([*others, _long(present[name])], 1)
        return shown, late

    def _vertices(self, shown: Arrays) -> Value:
        """The shown pose with its offsets, and what is static of them."""
        graph, model, body = self._graph, self._model, self._step.body
        with graph.section("skin"):
            shape, constant = self._step.betas, None
            if model.static.constant_m.any():
                shape = graph.concat([shape, self._step.past["known"]], 1)
                constant = model.static.constant_m
            skin = surface(graph, _with_static(body, model), slice(None), constant, self._precision)
            rest = skin.rest(shown["features"], shape)
        with graph.section("spread"):
            rest = rest + spread(graph, model.nodes, self._step.codes)
        with graph.section("skin"):
            bones = translated(graph, shown["bones"], shown["trans"])
            return skin.skinned(bones, rest)


def spread(graph: ValueGraph, nodes: TissueNodes, at_nodes: Value) -> Value:
    """(B, 3, V) offsets of all vertices from those of the nodes (B, 3, K)."""
    vertex_count = len(nodes.owners)
    near = [
        np.unique(nodes.owners[start : start + _BLOCK]) for start in range(0, vertex_count, _BLOCK)
    ]
    blocks, most = len(near), max(map(len, near))
    gathered = np.zeros((blocks, most), np.int64)
    shares = np.zeros((blocks, most, _BLOCK), np.float32)
    for block, mine in enumerate(near):
        gathered[block, : len(mine)] = mine
        vertices = np.arange(block * _BLOCK, min((block + 1) * _BLOCK, vertex_count))
        rows = np.searchsorted(mine, nodes.owners[vertices])  # (106, 8)
        shares[block, rows, (vertices % _BLOCK)[:, None]] = nodes.shares[vertices]
    # Rows of all characters are gathered at once: copying single numbers would take longest.
    by_node = at_nodes.transpose(2, 0, 1).reshape(len(nodes), -1)  # (K, 3 B)
    values = by_node.gather(gathered.ravel(), axis=0).reshape(blocks, most, -1)
    products = values.transpose(0, 2, 1) @ graph.array("shares", shares)  # (blocks, 3 B, 106)
    whole = products.transpose(1, 0, 2).reshape(-1, 3, blocks * _BLOCK)
    return whole if blocks * _BLOCK == vertex_count else whole.part(2, 0, vertex_count)


def _rows(value: Value, rows: Value) -> Value:
    """Those rows (1, N) of a value (B, ...)."""
    return value.gather(rows.reshape(-1), axis=0)


def _long(value: Value) -> Value:
    """(B, 1, ...) of (B, ...)."""
    return value.graph.apply("Unsqueeze", value, value.graph.integers([1]))


def _with_static(body: BodyModelData, model: TrainedPlus) -> BodyModelData:
    """The body whose pose blend shapes hold what is static by the pose: features are the same."""
    if not model.static.by_pose_m.any():
        return body
    by_pose_m = model.nodes.spread(model.static.by_pose_m)  # (207, V, 3)
    return replace(body, posedirs=body.posedirs + by_pose_m.transpose(1, 2, 0))
