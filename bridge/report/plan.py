"""Which figures a run's data allow: the paper's, under their numbers, and some more."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

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
    """A figure of the report; its caption stands in the page's template."""

    name: str
    """Its file's below `figures/`, without extension; the paper's begin with `figure`."""
    of: str
    """The sequence that it shows, if it is one."""
    draw: Callable[[Path], None]


def plan_figures(scene: Scene) -> list[FigurePlan]:
    """The figures that this run's data allow: the paper's by number, then what else it shows."""
    stages, evaluate = scene.stages, scene.stages["evaluate"]
    held_out, papers = validation_result(evaluate), "decode" in stages
    clip = scene.predicted()[held_out["name"]] if held_out else None
    train_ae, train = (stages[name] if papers else None for name in ("train-ae", "train"))
    plus, people = stages.get(TRAIN_PLUS), papers and _people_of_figure9(scene)
    # Nothing moves without test sequences whose true offsets are known.
    stopping = stopping_sequence(evaluate)
    candidates: tuple[tuple[str, Any, Callable[[Path, Any], None]], ...] = (
        ("figure1_strip", _unseen(scene), lambda path, one: draw_figure1(path, scene, one)),
        ("figure2_alignment", clip, lambda path, one: draw_figure2(path, scene, one)),
        ("figure3_autoencoder", train_ae, draw_figure3),
        ("figure4_autoencoder", papers and clip, lambda path, one: draw_figure4(path, scene, one)),
        ("figure5_dsnet", train, draw_figure5),
        ("figure6_lengths", scene.pipelines[0].align.artifact, draw_figure6),
        ("figure7_validation", clip, lambda path, one: draw_figure7(path, scene, one)),
        ("figure8_error", held_out, lambda path, one: draw_figure8(path, evaluate, one)),
        ("figure9_people", people, lambda path, one: draw_figure9(path, scene, one)),
        ("figure10_spine2", _turning(scene), lambda path, one: _draw_figure10(path, scene, one)),
        ("decay", stopping, lambda path, one: draw_offset_size(path, evaluate, one)),
        ("spectrum", stopping, lambda path, _: draw_spectrum(path, evaluate)),
        ("loss_autoencoder", train_ae, draw_autoencoder_loss),
        ("loss_dsnet", train, draw_dsnet_loss),
        ("loss_plus", plus if plus and plus_losses(plus) else None, draw_plus_loss),
    )
    return [
        FigurePlan(name, _name_of(subject), partial(_draw, draw, subject))
        for name, subject, draw in candidates
        if subject
    ]


def _draw(draw: Callable[[Path, Any], None], subject: Any, path: Path) -> None:
    draw(path, subject)


def _name_of(subject: Any) -> str:
    found = subject.get("name") if isinstance(subject, dict) else getattr(subject, "name", "")
    return str(found or "")


def _unseen(scene: Scene) -> MotionSequence | None:
    """The first test sequence of the hardest group that the run has."""
    predicted, hardest_first = scene.predicted(), list(reversed(CELLS))
    tested = [
        (hardest_first.index(one["cell"]), place, one["name"])
        for place, one in enumerate(scene.stages["evaluate"].manifest["per_sequence"])
        if one["split"] == "test" and one["name"] in predicted
    ]
    return predicted[min(tested)[-1]] if tested else None


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
