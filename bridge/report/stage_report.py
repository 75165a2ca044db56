"""`dsnet report`: figures, tables and pages from what the other stages left on disk."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tyro.conf import Fixed

from bridge.body import load_paper_body
from bridge.errors import DsnetError
from bridge.measure.pipelines import stages_of_pipelines
from bridge.options import PositiveInt
from bridge.report.bodies import Scene
from bridge.report.pages import render_html, render_markdown
from bridge.report.panels import FOOTERS
from bridge.report.plan import plan_figures
from bridge.report.results import departures, summarise
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
    said = {
        "figures": [plan for plan in plans if plan.name.startswith("figure")],
        "more": [plan for plan in plans if not plan.name.startswith("figure")],
        "departures": departures(scene.stages),
        "notice": notice,
    }
    markdown = render_markdown({"results": results, **said})
    page = writer.file_path("report.md")
    page.write_text(markdown, encoding="utf-8")
    html = render_html(markdown, page.parent, title=f"DSNet, run {run_name}", banner=notice)
    writer.file_path("report.html").write_text(html, encoding="utf-8")
