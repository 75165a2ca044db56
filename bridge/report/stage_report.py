"""`dsnet report`: figures, tables and pages from what the other stages left on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tyro.conf import Fixed

from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.measure.roads import stages_of_roads
from bridge.motion import MotionSequence
from bridge.motion.splits import CELLS
from bridge.options import PositiveInt
from bridge.report.body_figures import draw_figure4, draw_figure7, draw_test_strip
from bridge.report.curve_figures import (
    draw_autoencoder_loss,
    draw_dsnet_loss,
    draw_figure6,
    draw_figure8,
    draw_plus_loss,
    plus_losses,
)
from bridge.report.movement_figures import draw_offset_size, draw_spectrum, stopping_sequence
from bridge.report.page import render_html, render_markdown
from bridge.report.panels import FOOTERS
from bridge.report.parity_figure import draw_parity
from bridge.report.scene import Scene
from bridge.report.summary import departures, read_parity, summarise
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import INFER, INFER_PLUS, TRAIN_PLUS, body_model_path
from bridge.runs.workers import progress

_BESIDE = {"decode": ("train-ae", "encode", "train"), INFER_PLUS: (TRAIN_PLUS,)}
_OPTIONAL = ("corpus", "truth", "verify")
# As they are made: the page lists what each one took.
_ORDER = ("corpus", "truth", "align", "align_robust", "train-ae", "encode", "train", INFER,
          "decode", TRAIN_PLUS, INFER_PLUS, "evaluate", "verify")  # fmt: skip


@dataclass(frozen=True)
class ReportConfig:
    """Draw the figures and write the report: about a minute on two cores, less than 1 GB.

    Gives `report.md`, `report.html` (one file, pictures inside), `results.json`, `figures/`.
    """

    run: str = "demo"
    """Run to report on."""
    panel_px: Fixed[PositiveInt] = 300
    """Height of one rendered body in pixels."""


PROFILES = {
    "smoke": ReportConfig(run="smoke", panel_px=200),
    "demo": ReportConfig(run="demo"),
    "paper": ReportConfig(run="paper", panel_px=520),
}


@dataclass(frozen=True)
class FigurePlan:
    """A figure of the report."""

    name: str
    """File name below `figures/`, without its extension."""
    caption: str
    """What it shows, for the page."""
    draw: Callable[[Path], None]
    """Writes it."""


def main(config: ReportConfig) -> None:
    """Run the stage; a report that is current is kept.

    Raises
    ------
    DsnetError
        If the run lacks one of the stages before this one, or `evaluate` did when it was made.
    """
    run = Run(config.run)
    roads = stages_of_roads(run)
    named = {"evaluate", *roads, *(stage for stage in _OPTIONAL if run.finished(stage))}
    for last, beside in _BESIDE.items():
        named.update(beside if last in roads else ())
    stages = run.artifacts(*(stage for stage in _ORDER if stage in named))
    _require_measured(run, stages, roads)
    body = load_body_model(str(body_model_path(run)))
    scene = Scene(stages, body, config.panel_px)
    run.build(
        "report",
        config,
        lambda writer: _make(writer, scene, config.run),
        data=scene.origin,
        upstream=stages,
    )


def _require_measured(run: Run, stages: Mapping[str, Artifact], roads: Sequence[str]) -> None:
    evaluate = stages["evaluate"]
    measured = evaluate.manifest["upstream"]
    run.artifacts(*measured)  # what was deleted since is named
    of_truth = {"truth"} & set(stages) if evaluate.origin == "synthetic" else set()
    if missed := sorted({*roads, *of_truth} - set(measured)):
        raise DsnetError(
            f"run {run.name!r}, whose 'evaluate' was made without {', '.join(missed)}",
            "one that measured all that there is",
            f"Run `dsnet evaluate --run {run.name}` again.",
        )


def _make(writer: ArtifactWriter, scene: Scene, run_name: str) -> None:
    plans = plan_figures(scene)
    for plan in progress(plans, what="figures", unit="figure"):
        plan.draw(writer.file_path(f"figures/{plan.name}.png"))
    results = summarise(scene.stages, run_name, scene.body.gender)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    writer.file_path("results.json").write_text(text, encoding="utf-8")
    markdown = render_markdown(
        {
            "results": results,
            "figures": plans,
            "departures": departures(scene.stages),
            "notice": FOOTERS[scene.origin],
        }
    )
    page = writer.file_path("report.md")
    page.write_text(markdown, encoding="utf-8")
    html = render_html(
        markdown, page.parent, title=f"DSNet, run {run_name}", banner=FOOTERS[scene.origin]
    )
    writer.file_path("report.html").write_text(html, encoding="utf-8")


def plan_figures(scene: Scene) -> list[FigurePlan]:
    """The figures that this run's data allow, in the order of the page."""
    return [
        *_motion_figures(scene),
        *_movement_figures(scene.stages["evaluate"]),
        *_training_figures(scene),
        *_verification_figures(scene),
    ]


def _motion_figures(scene: Scene) -> list[FigurePlan]:
    validation, test = scene.validation(), _unseen(scene)
    plans = _validation_figures(scene, validation) if validation else []
    if test:
        caption = (
            f"Offsets predicted by {' and '.join(scene.shown.values())} for {test.name}, which "
            "nothing was trained on."
        )
        draw = partial(draw_test_strip, scene=scene, sequence=test)
        plans.append(FigurePlan("test_strip", caption, draw))
    return plans


def _movement_figures(evaluate: Artifact) -> list[FigurePlan]:
    """Nothing without test sequences whose true offsets are known."""
    sequence = stopping_sequence(evaluate)
    if sequence is None:
        return []
    return [
        FigurePlan(
            "decay",
            f"How the offsets swing and die away, {sequence['name']}: their mean length in each "
            "frame. Shaded: the body stands still.",
            partial(draw_offset_size, evaluate=evaluate, sequence=sequence),
        ),
        FigurePlan(
            "spectrum",
            "How fast the offsets move, over all test sequences: root mean square in each half "
            "hertz.",
            partial(draw_spectrum, evaluate=evaluate),
        ),
    ]


def _training_figures(scene: Scene) -> list[FigurePlan]:
    stages = scene.stages
    plans = [
        FigurePlan(
            "figure6_lengths",
            "Figure 6. Sequence lengths; shorter ones are padded with zeros, longer ones clipped.",
            lambda path: draw_figure6(path, scene.roads[0].align),
        )
    ]
    if scene.follows_paper:
        plans += [
            FigurePlan(
                "loss_autoencoder",
                "Loss of the autoencoder; epoch 0 is before the first step.",
                partial(draw_autoencoder_loss, train_ae=stages["train-ae"]),
            ),
            FigurePlan(
                "loss_dsnet",
                "Loss of each predictor. The latents' scales differ, so the values do too.",
                partial(draw_dsnet_loss, train=stages["train"]),
            ),
        ]
    if TRAIN_PLUS in stages and plus_losses(stages[TRAIN_PLUS]):
        draw = partial(draw_plus_loss, train_plus=stages[TRAIN_PLUS])
        plans.append(FigurePlan("loss_plus", "Loss of the best road's predictors.", draw))
    return plans


def _verification_figures(scene: Scene) -> list[FigurePlan]:
    if "verify" not in scene.stages:
        return []
    caption = (
        "What `dsnet verify` found: each engine's largest difference from a float64 NumPy "
        "reference, as the exponent of its size relative to the tensor's scale."
    )
    parity = read_parity(scene.stages["verify"])
    draw = partial(draw_parity, parity=parity, origin=scene.origin)
    return [FigurePlan("parity", caption, draw)]


def _validation_figures(scene: Scene, sequence: MotionSequence) -> list[FigurePlan]:
    plans = [
        FigurePlan(
            "figure7_validation",
            "Figure 7. (a) Ground truth, (b) SMPL from beta and theta, and for each road SMPL with "
            "the predicted offset and what the predictor contributes, in centimetres.",
            partial(draw_figure7, scene=scene, sequence=sequence),
        ),
        FigurePlan(
            "figure8_error",
            "Figure 8. Mean distance of the posed mesh's vertices from the registered mesh in each "
            "frame.",
            partial(draw_figure8, evaluate=scene.stages["evaluate"], sequence=sequence),
        ),
    ]
    if scene.follows_paper:
        caption = (
            "Figure 4. The original mesh, its reconstruction through 100 numbers, and the distance "
            "between the two in centimetres."
        )
        draw = partial(draw_figure4, scene=scene, sequence=sequence)
        plans.append(FigurePlan("figure4_autoencoder", caption, draw))
    return plans


def _unseen(scene: Scene) -> MotionSequence | None:
    """The first test sequence of the hardest cell that the run has."""
    hardest_first = list(reversed(CELLS))
    decoded = scene.decoded()
    tested = [
        one
        for one in scene.stages["evaluate"].manifest["per_sequence"]
        if one["split"] == "test" and one["name"] in decoded
    ]
    found = min(tested, key=lambda one: hardest_first.index(one["cell"]), default=None)
    return None if found is None else decoded[found["name"]]
