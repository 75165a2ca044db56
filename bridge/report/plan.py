"""Which figures a run's data allow: the paper's, under their numbers, and some more."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.measure.pipelines import MotionArrays
from bridge.motion import MotionSequence, unpack_theta
from bridge.motion.splits import CELLS, kind_of
from bridge.paper import ABSORBING_JOINT, ABSORBING_SEQUENCE, FIGURE9_MOTIONS
from bridge.report.bodies import (
    Scene,
    draw_figure1,
    draw_figure2,
    draw_figure4,
    draw_figure7,
    draw_figure9,
)
from bridge.report.curves import (
    TRUE_POSE,
    draw_autoencoder_loss,
    draw_dsnet_loss,
    draw_figure6,
    draw_figure8,
    draw_figure10,
    draw_offset_size,
    draw_plus_loss,
    draw_spectrum,
    plus_losses,
    stopping_sequence,
)
from bridge.report.diagrams import draw_figure3, draw_figure5
from bridge.report.paper_table import validation_result
from bridge.runs.run import TRAIN_PLUS


class FigurePlan(NamedTuple):
    """A figure of the report: its file's name below `figures/`, without extension."""

    name: str
    caption: str
    draw: Callable[[Path], None]


def plan_figures(scene: Scene) -> list[FigurePlan]:
    """The figures that this run's data allow: the paper's by number, then what else it shows."""
    return [*_papers_figures(scene), *_other_figures(scene)]


def _papers_figures(scene: Scene) -> list[FigurePlan]:
    stages, evaluate, plans = scene.stages, scene.stages["evaluate"], list[FigurePlan]()
    held_out, of_paper = validation_result(evaluate), "decode" in stages
    clip = scene.predicted()[held_out["name"]] if held_out else None
    shown = " and ".join(scene.shown.values())

    def add(name: str, caption: str, draw: Callable[[Path], None]) -> None:
        number = re.match(r"figure(\d+)", name)
        assert number
        plans.append(FigurePlan(name, f"Figure {number[1]}. {caption}", draw))

    if test := _unseen(scene):
        add(
            "figure1_strip",
            f"Offsets predicted by {shown} for {test.name}, which nothing was trained on.",
            lambda path: draw_figure1(path, scene, test),
        )
    if clip:
        add(
            "figure2_alignment",
            "The skin offset is what is left, at rest, of the mesh S when SMPL is aligned to it: "
            "Δ = W⁻¹(S) - M(β, θ). (a) The mesh, (b) unposed, (c) SMPL's shape, (d) its pose, "
            "(e) with the offset, coloured by its size.",
            lambda path: draw_figure2(path, scene, clip),
        )
    if of_paper:
        add(
            "figure3_autoencoder",
            "The autoencoder: grey boxes are data, vertices above and features below (heights by "
            "the logarithm); the convolutions take vertices as channels.",
            lambda path: draw_figure3(path, stages["train-ae"]),
        )
        if clip:
            add(
                "figure4_autoencoder",
                "The original mesh, its reconstruction through 100 numbers, and the distance "
                "between the two in centimetres.",
                lambda path: draw_figure4(path, scene, clip),
            )
        add(
            "figure5_dsnet",
            "The network unrolled; beside the arrows, how many numbers pass.",
            lambda path: draw_figure5(path, stages["train"]),
        )
    add(
        "figure6_lengths",
        "Sequence lengths; shorter ones are padded with zeros, longer ones clipped.",
        lambda path: draw_figure6(path, scene.pipelines[0].align.artifact),
    )
    if clip and held_out:
        add(
            "figure7_validation",
            "(a) Ground truth, (b) SMPL from beta and theta, and for each pipeline SMPL with the "
            "predicted offset and what the predictor contributes, in centimetres.",
            lambda path: draw_figure7(path, scene, clip),
        )
        add(
            "figure8_error",
            "Mean distance of the posed mesh's vertices from the registered mesh in each frame.",
            lambda path: draw_figure8(path, evaluate, held_out),
        )
    if of_paper and (people := _people_of_figure9(scene)):
        add(
            "figure9_people",
            "Offsets predicted for known people and (framed) new ones, in observed and unobserved "
            "motions.",
            lambda path: draw_figure9(path, scene, people),
        )
    if turning := _turning(scene):
        add(
            "figure10_spine2",
            f"Rotation vector of {ABSORBING_JOINT} over time, as each aligner fits it: what turns "
            "more than the true pose took over what the flesh did.",
            lambda path: _draw_figure10(path, scene, turning),
        )
    return plans


def _other_figures(scene: Scene) -> list[FigurePlan]:
    stages, evaluate, plans = scene.stages, scene.stages["evaluate"], list[FigurePlan]()
    # Nothing moves without test sequences whose true offsets are known.
    if stopping := stopping_sequence(evaluate):
        decay = (
            f"How the offsets swing and die away, {stopping['name']}: their mean length in each "
            "frame. Shaded: the body stands still."
        )
        plans += [
            FigurePlan("decay", decay, lambda path: draw_offset_size(path, evaluate, stopping)),
            FigurePlan(
                "spectrum",
                "How fast the offsets move, over all test sequences: root mean square in each half "
                "hertz.",
                lambda path: draw_spectrum(path, evaluate),
            ),
        ]
    if "decode" in stages:
        plans += [
            FigurePlan(
                "loss_autoencoder",
                "Loss of the autoencoder; epoch 0 is before the first step.",
                lambda path: draw_autoencoder_loss(path, stages["train-ae"]),
            ),
            FigurePlan(
                "loss_dsnet",
                "Loss of each predictor. The latents' scales differ, so the values do too.",
                lambda path: draw_dsnet_loss(path, stages["train"]),
            ),
        ]
    if TRAIN_PLUS in stages and plus_losses(stages[TRAIN_PLUS]):
        plus = "Loss of this repository's predictors."
        plans.append(
            FigurePlan("loss_plus", plus, lambda path: draw_plus_loss(path, stages[TRAIN_PLUS]))
        )
    return plans


def _unseen(scene: Scene) -> MotionSequence | None:
    """The first test sequence of the hardest group that the run has."""
    hardest_first = list(reversed(CELLS))
    predicted = scene.predicted()
    tested = [
        one
        for one in scene.stages["evaluate"].manifest["per_sequence"]
        if one["split"] == "test" and one["name"] in predicted
    ]
    found = min(tested, key=lambda one: hardest_first.index(one["cell"]), default=None)
    return None if found is None else predicted[found["name"]]


def _people_of_figure9(scene: Scene) -> dict[str, tuple[MotionSequence | None, ...]]:
    """By motion, a known person's sequence and a new one's; of the paper's motions if it can."""
    predicted = scene.predicted()
    found: dict[str, dict[str, MotionSequence]] = {}
    for one in scene.stages["evaluate"].manifest["per_sequence"]:
        if one["split"] != "train" and one["name"] in predicted:
            sequence = predicted[one["name"]]
            found.setdefault(kind_of(sequence.motion), {}).setdefault(one["person"], sequence)
    kinds = [kind for kind in FIGURE9_MOTIONS if kind in found] or list(found)
    return {
        kind.replace("_", " "): (found[kind].get("known"), found[kind].get("new"))
        for kind in kinds[: len(FIGURE9_MOTIONS)]
    }


def _turning(scene: Scene) -> MotionSequence | None:
    """The paper's sequence of Figure 10, or another of that motion."""
    motion = ABSORBING_SEQUENCE.partition("_")[2]
    aligned = scene.pipelines[0].align.places
    of_motion = {name: one for name, one in aligned.items() if one.motion == motion}
    return of_motion.get(ABSORBING_SEQUENCE, next(iter(of_motion.values()), None))


def _draw_figure10(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    motions = {
        f"fitted by {one.align.artifact.manifest['config']['aligner']}": one.align
        for one in scene.pipelines
    }
    if "truth" in scene.stages:
        motions = {TRUE_POSE: MotionArrays.of(scene.stages["truth"])} | motions
    joint = SMPL_JOINT_NAMES.index(ABSORBING_JOINT)
    turns = {
        label: unpack_theta(own.frames("theta", sequence.name, slice(None)))[0][:, joint]
        for label, own in motions.items()
    }
    title = f"Figure 10: rotation vector of {ABSORBING_JOINT}, {sequence.name}"
    draw_figure10(path, turns, fps=sequence.fps, title=title, origin=scene.origin)
