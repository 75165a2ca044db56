"""`dsnet_plus` as one ONNX graph: a pose in, the posed skin with its tissue out.

Inputs `theta` (B, 69), `betas` (B, 10), or as many as its body has, and `state` (B, S); outputs
`vertices` (B, V, 3), metres, and `next_state` (B, S). A character whose row of the state is zero
has no past: she begins settled in the pose that she is given, which costs a few tens of
milliseconds in that frame and nothing in later ones (`If` and `Loop`). So does one whose betas are
others than a frame before. A row is all that is known of a character: rows may be added, removed
and reordered from frame to frame.

Vertices are `latency_frames` old, pose and place included, as the model looks so far ahead.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import onnx

from bridge.body import BodyModelData
from bridge.paper import FPS, THETA_SIZE
from bridge.tissue.nodes import TissueNodes
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.onnx.body_graph import (
    BONES,
    TURNING,
    Surface,
    posed_bones,
    translated,
    translation,
    turned,
)
from dsnet.onnx.onnx_graph import Graph, Precision, StateLayout, Value
from dsnet.onnx.tissue_graph import SheetGraph, Springs, known_people, person_of

_BLOCK = 106
"""Vertices that follow one another, whose offsets are one matrix product of the nodes near them:
numbering follows the surface, so these are few. 65 blocks are SMPL's 6890 vertices."""
Arrays = dict[str, Value]


def plus_layout(model: TrainedPlus, skin: bool = True) -> StateLayout:
    """What a character's row holds, with or without what only the skin must know; K nodes, N taps,
    P known people, L frames of latency."""
    nodes, late = len(model.nodes), model.look_ahead
    shapes: dict[str, tuple[int, ...]] = {
        "age": (1,),
        "betas": (model.beta_count,),
        **Springs.shapes(nodes),
        "known": (len(model.people_betas) * skin,),
        "now": (3, nodes),
        "before": (3, nodes),
        "places": (3, nodes),
        "moves": (3, nodes),
        "turns": (9, nodes),
        "trans": (3,),
        "felt": (len(model.weights.taps) - 1, 3, nodes),
        "late_bones": (late * skin, 12, BONES),
        "late_features": (late * skin, TURNING),
        "late_trans": (late * skin, 3),
    }
    return StateLayout({name: shape for name, shape in shapes.items() if np.prod(shape)})


def plus_step_graph(model: TrainedPlus, body: BodyModelData) -> onnx.ModelProto:
    """The step of a trained `dsnet_plus` alone: outputs `codes` (B, 3, K), offsets of the nodes in
    the rest pose, metres, `look_ahead` frames ago, and `next_state`."""
    step = _PlusStep(model, body, plus_layout(model, skin=False))
    return step.graph.model(
        "dsnet_plus_step",
        {"codes": step.codes, "next_state": step.layout.written(step.graph, step.after)},
        checked=False,
    )


def plus_graph(
    model: TrainedPlus,
    body: BodyModelData,
    metadata: Mapping[str, str] | None = None,
    precision: Precision = "float32",
    in_parts: bool = False,
) -> onnx.ModelProto:
    """The same step and the skin, on the body model that a `dsnet_plus` is for.

    Of its kernels only the pose blend shapes are large; `precision` is theirs. `in_parts`: the
    skin is not posed, for who wants SMPL alone beside it: instead of `vertices` outputs are `rest`
    (B, 3, V) of SMPL alone and `offsets` (B, 3, V) in the rest pose, and `bones` (B, 12, 23).
    """
    step = _PlusStep(model, body, plus_layout(model))
    graph, count = step.graph, body.vertex_count
    shown, late = _shown(step)
    with graph.section("skin"):
        skin = Surface(graph, body, slice(None), precision)
        rest = skin.rest(shown["features"], step.betas)
        bones = translated(graph, shown["bones"], shown["trans"])
    with graph.section("spread"):
        offsets = _offsets(step, shown["features"])
    if in_parts:
        outputs = {"rest": rest, "offsets": offsets, "bones": bones}
        shapes = {"rest": ("B", 3, count), "offsets": ("B", 3, count), "bones": ("B", 12, BONES)}
    else:
        with graph.section("skin"):
            outputs = {"vertices": skin.skinned(bones, rest + offsets)}
        shapes = {"vertices": ("B", count, 3)}
    return graph.model(
        "dsnet_plus",
        outputs | {"next_state": step.layout.written(step.graph, step.after | late)},
        shapes | {"next_state": ("B", step.layout.size)},
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
        self.graph = graph = Graph()
        self._sheet = SheetGraph.of(graph, model)
        theta = graph.input("theta", ("B", THETA_SIZE))
        self.betas = graph.input("betas", ("B", model.beta_count))
        state = graph.input("state", ("B", layout.size))
        self.present = self._present(theta)
        self.past = layout.read(self._with_past(state))
        with graph.section("load"):
            after, loads = self._loads()
        with graph.section("oscillators"):
            past = self.past
            springs = Springs(**{name: past[name] for name in Springs.__dataclass_fields__})
            load = self._sheet.smoothed(loads)
            now, before = self._sheet.frame(springs, past["now"], past["before"], load)
            if model.look_ahead > 1:  # else the loads of rest are all that was known
                # Loads are known early: offsets rest until the first frame is shown.
                going = (past["age"] + -float(model.look_ahead)).clip(0.0, 1.0).reshape(0, 1, 1)
                now = past["now"] + going * (now - past["now"])
                before = past["before"] + going * (before - past["before"])
        self.codes = now
        self.after: Arrays = past | after | {"now": now, "before": before}

    def _present(self, theta: Value) -> Arrays:
        """Of this frame: places of the nodes about the root, turns, bones."""
        graph, vertices = self.graph, self.model.nodes.vertices
        bones, turning = posed_bones(graph, self.body, theta, self.betas)
        with graph.section("nodes"):
            nodes = Surface(graph, self.body, vertices)
            # As if weights summed to 1: then standing is no turn, and no load.
            missing = 1 - self.body.weights[vertices].sum(axis=1)
            still = np.append(np.eye(3).ravel(), np.zeros(3))[:, None]
            blended = bones @ nodes.weights + graph.array("missing", still * missing)
            *columns, shift = blended.split(1, [3, 3, 3, 3])
            return {
                "places": turned(columns, shift, nodes.rest(turning, self.betas)),
                "turns": graph.concat(columns, 1),
                "trans": translation(theta),
                "bones": bones,
                "features": turning,
            }

    def _with_past(self, state: Value) -> Value:
        """The state, where those without a past have been given one."""
        graph, betas = self.graph, self.betas
        with graph.section("past"):
            age, betas_before = state.part(1, 0, 1), state.part(1, 1, 1 + self.model.beta_count)
            apart = graph.apply("Abs", betas - betas_before).max(1)
            new = graph.apply("Max", apart, 1.0 + -age) > 0.0  # (B, 1)
            count = graph.apply("Cast", new, to=1).max(0, 1).reshape()

            def begun() -> Value:
                rows = graph.apply("NonZero", new.reshape(-1))  # (1, N)
                chosen = rows.reshape(-1)
                mine = {name: value.gather(chosen, 0) for name, value in self.present.items()}
                fresh = self._begun(betas.gather(chosen, 0), mine)
                return graph.apply("ScatterND", state, rows.transpose(1, 0), fresh)

            return graph.choose(count > 0.0, begun, lambda: state)

    def _begun(self, betas: Value, present: Arrays) -> Value:
        """Rows of those who have stood in the present pose for ever."""
        graph = self.graph
        person = person_of(graph, self.body, self.model, betas)
        with graph.section("settled"):
            springs = self._sheet.springs(person)
            load = self._sheet.load(None, present["turns"].split(1, [3, 3, 3]))
            offsets_m = self._sheet.settled(springs, load)
            begun = {
                "age": (0.0 * present["trans"]).part(1, 0, 1),
                "betas": betas,
                **vars(springs),
                "now": offsets_m,
                "before": offsets_m,
                "places": present["places"],
                "moves": 0.0 * offsets_m,
                "turns": present["turns"],
                "trans": present["trans"],
                "felt": graph.concat([load] * max(len(self.model.weights.taps) - 1, 1), 1),
            }
            if "known" in self.layout.shapes:
                begun["known"] = known_people(graph, self.model, betas)
            frames = max(self.model.look_ahead, 1)
            for name in ("bones", "features", "trans"):
                begun[f"late_{name}"] = graph.concat([_long(present[name])] * frames, 1)
            return self.layout.written(graph, begun)

    def _loads(self) -> tuple[Arrays, list[Value]]:
        """What the next frame must know, and loads, the newest first: of the frame before this.

        Places are about the root, whose own way is differenced apart: far from the origin a sum
        of both would have lost the digits that accelerations are made of. What moves in her first
        frame moved before it too, as in whole clips, so that frame has no acceleration.
        """
        graph, past, present = self.graph, self.past, self.present
        nodes, kept = len(self.model.nodes), len(self.model.weights.taps) - 1
        steps = (present["trans"] - past["trans"]).reshape(0, 3, 1)
        moves = (present["places"] - past["places"]) + steps
        young = past["age"].reshape(0, 1, 1)  # 0, 1, then what has an acceleration
        acceleration = FPS**2 * (young - 1.0).clip(0.0, 1.0) * (moves - past["moves"])
        after = {name: present[name] for name in ("places", "turns", "trans")} | {"moves": moves}
        age = float(max(2, self.model.look_ahead + 1))
        after["age"] = graph.apply("Min", past["age"] + 1.0, age)
        loads = [self._sheet.load(acceleration, past["turns"].split(1, [3, 3, 3]))]
        if kept:
            older = past["felt"].reshape(0, 3 * kept, nodes).split(1, [3] * kept)
            after["felt"] = graph.concat([*loads, *older[:-1]], 1)
            loads += older
        return after, loads


def _shown(step: _PlusStep) -> tuple[Arrays, Arrays]:
    """Bones, features and place as late as the step's offsets are, and what the next frame must
    know of later ones."""
    graph, frames = step.graph, step.model.look_ahead
    shown = {name: step.present[name] for name in ("bones", "features", "trans")}
    late: Arrays = {}
    for name in shown if frames else ():
        oldest, *others = step.past[f"late_{name}"].split(1, [1] * frames)
        late[f"late_{name}"] = graph.concat([*others, _long(shown[name])], 1)
        shown[name] = oldest.reshape(0, *step.layout.shapes[f"late_{name}"][1:])
    return shown, late


def _offsets(step: _PlusStep, features: Value) -> Value:
    """(B, 3, V) in the rest pose: of the step's nodes, and what is static."""
    graph, model, codes = step.graph, step.model, step.codes
    by_pose_m, constant_m = model.static.by_pose_m[:TURNING], model.static.constant_m
    if by_pose_m.any():
        kernel = by_pose_m.transpose(0, 2, 1).reshape(TURNING, -1)
        moved = features @ graph.array("static_by_pose", kernel)
        codes = codes + moved.reshape(0, 3, len(model.nodes))
    offsets = spread(graph, model.nodes, codes)
    if constant_m.any():
        kernel = constant_m.transpose(0, 2, 1).reshape(len(constant_m), -1)
        known = step.past["known"] @ graph.array("static_constant", kernel)
        offsets = offsets + known.reshape(0, 3, -1)
    return offsets


def spread(graph: Graph, nodes: TissueNodes, at_nodes: Value) -> Value:
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


def _long(value: Value) -> Value:
    """(B, 1, ...) of (B, ...)."""
    return value.graph.apply("Unsqueeze", value, value.graph.integers([1]))
