"""`dsnet report`: figures, tables and pages from what the other stages left on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from tyro.conf import Fixed

from bridge.body import load_paper_body
from bridge.errors import DsnetError
from bridge.measure.pipelines import stages_of_pipelines
from bridge.motion import MotionSequence
from bridge.motion.splits import CELLS
from bridge.options import PositiveInt
from bridge.report.bodies import Scene, draw_figure4, draw_figure7, draw_test_strip
from bridge.report.curves import (
    draw_autoencoder_loss,
    draw_dsnet_loss,
    draw_figure6,
    draw_figure8,
    draw_offset_size,
    draw_plus_loss,
    draw_spectrum,
    plus_losses,
    stopping_sequence,
)
from bridge.report.panels import FOOTERS
from bridge.report.paper_table import validation_result
from bridge.report.results import (
    departures,
    render_html,
    render_markdown,
    summarise,
)
from bridge.report.seeds import of_other_seeds
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


def main(config: ReportConfig) -> None:
    run = Run(config.run)
    last = stages_of_pipelines(run)
    named = {"evaluate", *last, *(stage for stage in _OPTIONAL if run.finished(stage))}
    named.update(*(beside for stage, beside in _BESIDE.items() if stage in last))
    stages = run.artifacts(*(stage for stage in _ORDER if stage in named))
    _require_measured(run, stages, last)
    body = load_paper_body(str(body_model_path(run)))
    scene = Scene(stages, body, config.panel_px)
    others = of_other_seeds(run, stages["evaluate"])
    run.build(
        "report",
        config,
        lambda writer: _make(writer, scene, config.run, others),
        data=scene.origin,
        upstream=stages | {f"seed_{seed}": evaluate for seed, evaluate in others.items()},
    )


def _require_measured(run: Run, stages: Mapping[str, Artifact], last: Sequence[str]) -> None:
    evaluate = stages["evaluate"]
    measured = evaluate.manifest["upstream"]
    run.artifacts(*measured)  # what was deleted since is named
    of_truth = {"truth"} & set(stages) if evaluate.origin == "synthetic" else set()
    if missed := sorted({*last, *of_truth} - set(measured)):
        raise DsnetError(
            f"run {run.name!r}, whose 'evaluate' was made without {', '.join(missed)}",
            "one that measured all that there is",
            f"Run `dsnet evaluate --run {run.name}` again.",
        )


def _make(
    writer: ArtifactWriter, scene: Scene, run_name: str, others: Mapping[int, Artifact]
) -> None:
    plans = plan_figures(scene)
    for plan in progress(plans, what="figures", unit="figure"):
        plan.draw(writer.file_path(f"figures/{plan.name}.png"))
    results = summarise(scene.stages, run_name, scene.body.gender, others)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    writer.file_path("results.json").write_text(text, encoding="utf-8")
    notice = FOOTERS[scene.origin]
    said = {"figures": plans, "departures": departures(scene.stages), "notice": notice}
    markdown = render_markdown({"results": results, **said})
    page = writer.file_path("report.md")
    page.write_text(markdown, encoding="utf-8")
    html = render_html(markdown, page.parent, title=f"DSNet, run {run_name}", banner=notice)
    writer.file_path("report.html").write_text(html, encoding="utf-8")


class FigurePlan(NamedTuple):
    """A figure of the report: its file's name below `figures/`, without extension."""

    name: str
    caption: str
    draw: Callable[[Path], None]


def plan_figures(scene: Scene) -> list[FigurePlan]:
    """The figures that this run's data allow, in the order of the page."""
    stages, evaluate = scene.stages, scene.stages["evaluate"]
    plans: dict[str, tuple[str, Callable[[Path], None]]] = {}
    if held_out := validation_result(evaluate):
        sequence = scene.predicted()[held_out["name"]]
        plans["figure7_validation"] = (
            "Figure 7. (a) Ground truth, (b) SMPL from beta and theta, and for each pipeline SMPL "
            "with the predicted offset and what the predictor contributes, in centimetres.",
            lambda path: draw_figure7(path, scene, sequence),
        )
        plans["figure8_error"] = (
            "Figure 8. Mean distance of the posed mesh's vertices from the registered mesh in each "
            "frame.",
            lambda path: draw_figure8(path, evaluate, held_out),
        )
        if "decode" in stages:
            plans["figure4_autoencoder"] = (
                "Figure 4. The original mesh, its reconstruction through 100 numbers, and the "
                "distance between the two in centimetres.",
                lambda path: draw_figure4(path, scene, sequence),
            )
    if test := _unseen(scene):
        plans["test_strip"] = (
            f"Offsets predicted by {' and '.join(scene.shown.values())} for {test.name}, which "
            "nothing was trained on.",
            lambda path: draw_test_strip(path, scene, test),
        )
    # Nothing moves without test sequences whose true offsets are known.
    if stopping := stopping_sequence(evaluate):
        plans["decay"] = (
            f"How the offsets swing and die away, {stopping['name']}: their mean length in each "
            "frame. Shaded: the body stands still.",
            lambda path: draw_offset_size(path, evaluate, stopping),
        )
        plans["spectrum"] = (
            "How fast the offsets move, over all test sequences: root mean square in each half "
            "hertz.",
            lambda path: draw_spectrum(path, evaluate),
        )
    plans["figure6_lengths"] = (
        "Figure 6. Sequence lengths; shorter ones are padded with zeros, longer ones clipped.",
        lambda path: draw_figure6(path, scene.pipelines[0].align.artifact),
    )
    if "decode" in stages:
        plans["loss_autoencoder"] = (
            "Loss of the autoencoder; epoch 0 is before the first step.",
            lambda path: draw_autoencoder_loss(path, stages["train-ae"]),
        )
        plans["loss_dsnet"] = (
            "Loss of each predictor. The latents' scales differ, so the values do too.",
            lambda path: draw_dsnet_loss(path, stages["train"]),
        )
    if TRAIN_PLUS in stages and plus_losses(stages[TRAIN_PLUS]):
        plans["loss_plus"] = (
            "Loss of this repository's predictors.",
            lambda path: draw_plus_loss(path, stages[TRAIN_PLUS]),
        )
    return [FigurePlan(name, *plan) for name, plan in plans.items()]


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
