"""`dsnet_plus` as one ONNX graph: a pose in, the posed skin with its soft tissue out.

Inputs are `theta` (B, 69), `betas` (B, 10), or as many as the body has, and `state` (B, S); outputs
are `vertices` (B, V, 3), metres, and `next_state` (B, S). A character whose row of the state is
zero, or whose betas have changed, starts in static equilibrium in the given pose; this takes a few
tens of milliseconds in that frame alone (`If` and `Loop`). A row holds everything about a
character, so rows may be added, removed and reordered from frame to frame.

Vertices are `latency_frames` late, pose and translation included, by the model's look-ahead.
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
    POSE_FEATURES,
    Surface,
    posed_bones,
    translated,
    translation,
    turned,
)
from dsnet.onnx.onnx_graph import Graph, StateLayout, Value
from dsnet.onnx.precision import Precision
from dsnet.onnx.tissue_graph import Springs, TissueGraph, tissue_constants, training_people

Arrays = dict[str, Value]


def plus_layout(model: TrainedPlus, skin: bool = True) -> StateLayout:
    """The state of a character, with or without the arrays that only the skin needs.

    Exported files have these names in their metadata, so they stay.
    """
    nodes, latency = len(model.nodes), model.look_ahead
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
        "late_bones": (latency * skin, 12, BONES),
        "late_features": (latency * skin, POSE_FEATURES),
        "late_trans": (latency * skin, 3),
    }
    return StateLayout({name: shape for name, shape in shapes.items() if np.prod(shape)})


def plus_step_graph(model: TrainedPlus, body: BodyModelData) -> onnx.ModelProto:
    """One step of a trained `dsnet_plus` without the skin.

    Outputs are `codes` (B, 3, K), offsets of the nodes in the rest pose, metres, `look_ahead`
    frames ago, and `next_state`.
    """
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
    control_flow: bool = True,
    with_offsets: bool = False,
) -> onnx.ModelProto:
    """One step of a trained `dsnet_plus` with the skin of its body model.

    Parameters
    ----------
    precision : of the pose blend shapes, the only large kernel.
    in_parts : give, in place of `vertices`, `rest` (B, 3, V) of SMPL alone, `offsets` (B, 3, V) in
        the rest pose, and `bones` (B, 12, 23), so that both can be skinned.
    control_flow : without it no operator holds a graph (`If`, `Loop`, `Scan`): the state of who
        begins is that of `plus_begin_graph`.
    with_offsets : `offsets` (B, V, 3) in the rest pose, metres, are an output too.
    """
    step = _PlusStep(model, body, plus_layout(model), control_flow)
    graph, count = step.graph, body.vertex_count
    shown, later = _delayed(step)
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
            if with_offsets:
                outputs["offsets"] = offsets.transpose(0, 2, 1)
        shapes = dict.fromkeys(outputs, ("B", count, 3))
    return graph.model(
        "dsnet_plus",
        outputs | {"next_state": step.layout.written(step.graph, step.after | later)},
        shapes | {"next_state": ("B", step.layout.size)},
        {
            **(metadata or {}),
            "latency_frames": str(model.look_ahead),
            "state_layout": step.layout.as_text(),
        },
    )


def plus_begin_graph(model: TrainedPlus, body: BodyModelData) -> onnx.ModelProto:
    """The state of characters who begin, for `plus_graph` without control flow.

    Inputs are `theta` (B, 69), the first pose, which the step is given again, and `betas` (B, 10);
    output is `state` (B, S): they have stood in that pose forever.
    """
    layout = plus_layout(model)
    pose = _PlusPose(model, body, layout, control_flow=False)
    state = pose.initial_state(pose.betas, pose.present)
    return pose.graph.model("dsnet_plus_begin", {"state": state}, {"state": ("B", layout.size)})


class _PlusPose:
    """B characters in a pose `present`, and the state of those who begin in it."""

    def __init__(
        self, model: TrainedPlus, body: BodyModelData, layout: StateLayout, control_flow: bool
    ) -> None:
        self.model, self.body, self.layout = model, body, layout
        self.graph = graph = Graph(control_flow)
        self._tissue = TissueGraph.of(graph, model)
        theta = graph.input("theta", ("B", THETA_SIZE))
        self.betas = graph.input("betas", ("B", model.beta_count))
        self.present = self._present(theta)

    def _present(self, theta: Value) -> Arrays:
        """Of this pose: positions of the nodes relative to the root, their rotations, the bones."""
        graph, vertices = self.graph, self.model.nodes.vertices
        bones, features = posed_bones(graph, self.body, theta, self.betas)
        with graph.section("nodes"):
            nodes = Surface(graph, self.body, vertices)
            # Make weights sum to 1 exactly, so that the rest pose has no rotation and no load.
            missing = 1 - self.body.weights[vertices].sum(axis=1)
            identity = np.append(np.eye(3).ravel(), np.zeros(3))[:, None]
            blended = bones @ nodes.weights + graph.array("missing", identity * missing)
            *columns, shift = blended.split(1, [3, 3, 3, 3])
            return {
                "places": turned(columns, shift, nodes.rest(features, self.betas)),
                "turns": graph.concat(columns, 1),
                "trans": translation(theta),
                "bones": bones,
                "features": features,
            }

    def initial_state(self, betas: Value, present: Arrays) -> Value:
        """Rows of characters in static equilibrium in the present pose."""
        graph = self.graph
        constants = tissue_constants(graph, self.body, self.model, betas)
        with graph.section("settled"):
            springs = self._tissue.springs(constants)
            load = self._tissue.load(None, present["turns"].split(1, [3, 3, 3]))
            offsets_m = self._tissue.settled(springs, load)
            state = {
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
                state["known"] = training_people(graph, self.model, betas)
            frames = max(self.model.look_ahead, 1)
            for name in ("bones", "features", "trans"):
                state[f"late_{name}"] = graph.concat([_with_time(present[name])] * frames, 1)
            return self.layout.written(graph, state)


class _PlusStep(_PlusPose):
    """One frame of B characters: state `past`, new pose `present`, next state `after`."""

    def __init__(
        self,
        model: TrainedPlus,
        body: BodyModelData,
        layout: StateLayout,
        control_flow: bool = True,
    ) -> None:
        super().__init__(model, body, layout, control_flow)
        graph = self.graph
        state = graph.input("state", ("B", layout.size))
        self.past = layout.read(self._with_past(state) if control_flow else state)
        with graph.section("load"):
            after, loads = self._loads()
        with graph.section("oscillators"):
            past = self.past
            springs = Springs(**{name: past[name] for name in Springs.__dataclass_fields__})
            load = self._tissue.smoothed(loads)
            now, before = self._tissue.frame(springs, past["now"], past["before"], load)
            if model.look_ahead > 1:  # otherwise the only loads so far are those of rest
                # Offsets stay in equilibrium until the first frame is shown.
                moving = (past["age"] + -float(model.look_ahead)).clip(0.0, 1.0).reshape(0, 1, 1)
                now = past["now"] + moving * (now - past["now"])
                before = past["before"] + moving * (before - past["before"])
        self.codes = now
        self.after: Arrays = past | after | {"now": now, "before": before}

    def _with_past(self, state: Value) -> Value:
        """The state, in which new characters are in equilibrium in their present pose."""
        graph, betas = self.graph, self.betas
        with graph.section("past"):
            age, betas_before = state.part(1, 0, 1), state.part(1, 1, 1 + self.model.beta_count)
            apart = graph.apply("Abs", betas - betas_before).max(1)
            new = graph.apply("Max", apart, 1.0 + -age) > 0.0  # (B, 1)
            count = graph.apply("Cast", new, to=1).max(0, 1).reshape()

            def begin() -> Value:
                rows = graph.apply("NonZero", new.reshape(-1))  # (1, N)
                chosen = rows.reshape(-1)
                present = {name: value.gather(chosen, 0) for name, value in self.present.items()}
                begun = self.initial_state(betas.gather(chosen, 0), present)
                return graph.apply("ScatterND", state, rows.transpose(1, 0), begun)

            return graph.choose(count > 0.0, begin, lambda: state)

    def _loads(self) -> tuple[Arrays, list[Value]]:
        """Arrays of the next state, and the loads of the frame before this, the newest first.

        Positions are relative to the root, whose translation is differenced separately: far from
        the origin their sum would lose the digits that accelerations need. The first frame has no
        acceleration: as in whole clips, its velocity is taken to have been the same before.
        """
        graph, past, present = self.graph, self.past, self.present
        nodes, older_taps = len(self.model.nodes), len(self.model.weights.taps) - 1
        steps = (present["trans"] - past["trans"]).reshape(0, 3, 1)
        moves = (present["places"] - past["places"]) + steps
        age = past["age"].reshape(0, 1, 1)  # 0 and 1 have no acceleration
        acceleration = FPS**2 * (age - 1.0).clip(0.0, 1.0) * (moves - past["moves"])
        after = {name: present[name] for name in ("places", "turns", "trans")} | {"moves": moves}
        oldest = float(max(2, self.model.look_ahead + 1))
        after["age"] = graph.apply("Min", past["age"] + 1.0, oldest)
        loads = [self._tissue.load(acceleration, past["turns"].split(1, [3, 3, 3]))]
        if older_taps:
            older = past["felt"].reshape(0, 3 * older_taps, nodes).split(1, [3] * older_taps)
            after["felt"] = graph.concat([*loads, *older[:-1]], 1)
            loads += older
        return after, loads


def _delayed(step: _PlusStep) -> tuple[Arrays, Arrays]:
    """Bones, features and translation with the latency of the offsets, and those of later frames as
    arrays of the next state."""
    graph, frames = step.graph, step.model.look_ahead
    shown = {name: step.present[name] for name in ("bones", "features", "trans")}
    later: Arrays = {}
    for name in shown if frames else ():
        oldest, *others = step.past[f"late_{name}"].split(1, [1] * frames)
        later[f"late_{name}"] = graph.concat([*others, _with_time(shown[name])], 1)
        shown[name] = oldest.reshape(0, *step.layout.shapes[f"late_{name}"][1:])
    return shown, later


def _offsets(step: _PlusStep, features: Value) -> Value:
    """Offsets (B, 3, V) in the rest pose: interpolated from the nodes, plus the static part."""
    graph, model, codes = step.graph, step.model, step.codes
    by_pose_m, constant_m = model.static.by_pose_m[:POSE_FEATURES], model.static.constant_m
    if by_pose_m.any():
        kernel = by_pose_m.transpose(0, 2, 1).reshape(POSE_FEATURES, -1)
        static = features @ graph.array("static_by_pose", kernel)
        codes = codes + static.reshape(0, 3, len(model.nodes))
    offsets = interpolated(graph, model.nodes, codes)
    if constant_m.any():
        kernel = constant_m.transpose(0, 2, 1).reshape(len(constant_m), -1)
        static = step.past["known"] @ graph.array("static_constant", kernel)
        offsets = offsets + static.reshape(0, 3, -1)
    return offsets


def interpolated(graph: Graph, nodes: TissueNodes, at_nodes: Value) -> Value:
    """Offsets (B, 3, V) of all vertices, interpolated from those of the nodes (B, 3, K)."""
    vertex_count = len(nodes.owners)
    of_blocks, shares = nodes.blocks()
    blocks, most, size = shares.shape
    # Gather whole rows, for all characters at once: copying single numbers is slow.
    by_node = at_nodes.transpose(2, 0, 1).reshape(len(nodes), -1)  # (K, 3 B)
    values = by_node.gather(of_blocks.ravel(), axis=0).reshape(blocks, most, -1)
    products = values.transpose(0, 2, 1) @ graph.array("shares", shares)  # (blocks, 3 B, 106)
    whole = products.transpose(1, 0, 2).reshape(-1, 3, blocks * size)
    return whole if blocks * size == vertex_count else whole.part(2, 0, vertex_count)


def _with_time(value: Value) -> Value:
    """(B, ...) as (B, 1, ...)."""
    return value.graph.apply("Unsqueeze", value, value.graph.integers([1]))
