"""`dsnet report`: figures, tables and pages from the artifacts of the other stages."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tyro.conf import Fixed

from bridge.body import load_paper_body
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.errors import DsnetError, notify
from bridge.motion import MotionSequence, unpack_theta
from bridge.motion.splits import CELLS, kind_of
from bridge.options import PositiveInt
from bridge.paper import ABSORBING_JOINT, ABSORBING_SEQUENCE, FIGURE9_MOTIONS
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.run import INFER, INFER_PLUS, TRAIN_PLUS, body_model_path
from bridge.runs.workers import progress
from dsnet.evaluation.pipelines import MotionArrays, stages_of_pipelines
from dsnet.pictures.panels import FOOTERS
from dsnet.report.bodies import (
    Scene,
    draw_figure1,
    draw_figure2,
    draw_figure4,
    draw_figure7,
    draw_figure9,
)
from dsnet.report.curves import (
    TRUE_POSE,
    draw_autoencoder_loss,
    draw_figure6,
    draw_figure8,
    draw_figure10,
    draw_offset_size,
    draw_predictor_losses,
    draw_spectrum,
    liveliest_sequence,
)
from dsnet.report.diagrams import draw_figure3, draw_figure5
from dsnet.report.pages import render_html, render_markdown
from dsnet.report.paper_table import validation_result
from dsnet.report.results import departures, of_other_seeds, summarise
from dsnet.report.update import update_stages
from dsnet.report.videos import can_encode, write_videos

_TRAINING_OF = {"decode": ("train-ae", "encode", "train"), INFER_PLUS: (TRAIN_PLUS,)}
_OPTIONAL = ("corpus", "truth", "verify")
# In the order in which they run: the page lists the time of each.
_ORDER = ("corpus", "truth", "align", "align_robust", "train-ae", "encode", "train", INFER,
          "decode", TRAIN_PLUS, INFER_PLUS, "evaluate", "verify")  # fmt: skip


@dataclass(frozen=True)
class ReportConfig:
    """Draw the figures and write the report: one to two minutes on two cores, less than 1 GB.

    Gives `report.md`, `report.html` (one file, pictures inside; a held-out motion moves at its
    head), `results.json`, `figures/` and, where the extra `clip` is installed, `videos/`.
    """

    run: str = "demo"
    """Run to report on."""
    update: bool = False
    """First run again, with the options they had, the stages that a change has made old: after a
    new predictor was trained this infers, decodes, evaluates and verifies."""
    panel_px: Fixed[PositiveInt] = 300
    """Height of one rendered body in pixels."""
    video_pictures: Fixed[PositiveInt] = 60
    """Most pictures of what moves, 30 a second."""


PROFILES = {
    "smoke": ReportConfig(run="smoke", panel_px=200, video_pictures=4),
    "demo": ReportConfig(run="demo"),
    "paper": ReportConfig(run="paper", panel_px=520),
}


def main(config: ReportConfig) -> None:
    run = Run(config.run)
    if config.update:
        update_stages(run, [stage for stage in _ORDER if run.finished(stage)])
    last = stages_of_pipelines(run)
    named = {"evaluate", *last, *(stage for stage in _OPTIONAL if run.finished(stage))}
    parity_is_old = "verify" in named and not _is_current(run, "verify")
    if parity_is_old:
        named.remove("verify")
    named.update(*(training for stage, training in _TRAINING_OF.items() if stage in last))
    stages = run.artifacts(*(stage for stage in _ORDER if stage in named))
    _require_measured(run, stages, last)
    if parity_is_old:
        notify("left out: the table of parity; run `dsnet verify` again, its inputs have changed")
    body = load_paper_body(str(body_model_path(run)))
    scene = Scene(stages, body, config.panel_px)
    others = of_other_seeds(run, stages["evaluate"])
    run.build(
        "report",
        {
            "panel_px": config.panel_px,
            "video_pictures": config.video_pictures,
            "videos": can_encode(),
        },
        lambda writer: _make(writer, scene, config, others),
        data=scene.origin,
        upstream=stages | {f"seed_{seed}": evaluate for seed, evaluate in others.items()},
    )


def _is_current(run: Run, stage: str) -> bool:
    """Whether a stage was made from the artifacts that the run has now."""
    try:
        run.artifacts(stage)
    except DsnetError:
        return False
    return True


def _require_measured(run: Run, stages: Mapping[str, Artifact], last: Sequence[str]) -> None:
    evaluate = stages["evaluate"]
    measured = evaluate.manifest["upstream"]
    run.artifacts(*measured)  # raises an error that names what was deleted since
    of_truth = {"truth"} & set(stages) if evaluate.origin == "synthetic" else set()
    if missed := sorted({*last, *of_truth} - set(measured)):
        raise DsnetError(
            f"run {run.name!r}, whose 'evaluate' was made without {', '.join(missed)}",
            "one that measured all that there is",
            f"Run `dsnet evaluate --run {run.name}` again.",
        )


def _make(
    writer: ArtifactWriter, scene: Scene, config: ReportConfig, others: Mapping[int, Artifact]
) -> None:
    figures = plan_figures(scene)
    for figure in progress(figures, what="figures", unit="figure"):
        figure.draw(writer.file_path(f"figures/{figure.name}.png"))
    videos = write_videos(writer, figures, config.video_pictures)
    results = summarise(scene.stages, config.run, scene.body.gender, others)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    writer.file_path("results.json").write_text(text, encoding="utf-8")
    page = writer.file_path("report.md")
    markdown = render_markdown(results, figures, departures(scene.stages), videos)
    page.write_text(markdown, encoding="utf-8")
    banner = FOOTERS[scene.origin]
    html = render_html(markdown, page.parent, title=f"DSNet, run {config.run}", banner=banner)
    writer.file_path("report.html").write_text(html, encoding="utf-8")


class Figure(NamedTuple):
    """A figure of the report; its caption is in the page's template."""

    name: str
    """File name below `figures/`, without extension; names of the paper's begin with `figure`."""
    function: Callable[..., None]
    arguments: Sequence[Any]
    """Arguments of the function after the path; the last one is what the figure shows."""

    def draw(self, path: Path) -> None:
        self.function(path, *self.arguments)

    @property
    def of(self) -> str:
        """Name of the sequence that the figure shows, empty if it shows something else."""
        shown = self.arguments[-1]
        named = shown.get("name") if isinstance(shown, dict) else getattr(shown, "name", "")
        return str(named or "")


def plan_figures(scene: Scene) -> list[Figure]:
    """The figures that the run has data for: the paper's by number, then the others."""
    stages, evaluate = scene.stages, scene.stages["evaluate"]
    validation, has_dsnet = validation_result(evaluate), "decode" in stages
    clip = scene.predicted()[validation["name"]] if validation else None
    train_ae, train = (stages[name] if has_dsnet else None for name in ("train-ae", "train"))
    plus = stages.get(TRAIN_PLUS)
    # A predictor that is solved in closed form has no losses.
    has_losses = plus and any(name.startswith("loss_") for name in plus.manifest["arrays"])
    # None without test sequences whose true offsets are known.
    lively = liveliest_sequence(evaluate)
    of_dsnet = "Loss of DSNet (Section 4.3)", "epoch", "loss of a sequence"
    of_plus = "Loss of this repository's predictors", "step", "loss"
    planned: list[tuple[Any, ...]] = [  # name, function, arguments; falsy last ones are left out
        ("figure1_strip", draw_figure1, scene, _unseen(scene)),
        ("figure2_alignment", draw_figure2, scene, clip),
        ("figure3_autoencoder", draw_figure3, train_ae),
        ("figure4_autoencoder", draw_figure4, scene, has_dsnet and clip),
        ("figure5_dsnet", draw_figure5, train),
        ("figure6_lengths", draw_figure6, scene.pipelines[0].align.artifact),
        ("figure7_validation", draw_figure7, scene, clip),
        ("figure8_error", draw_figure8, evaluate, validation),
        ("figure9_people", draw_figure9, scene, has_dsnet and _subjects_of_figure9(scene)),
        ("figure10_spine2", _draw_figure10, scene, _sequence_of_figure10(scene)),
        ("over_time", draw_offset_size, evaluate, lively),
        ("spectrum", draw_spectrum, lively and evaluate),
        ("loss_autoencoder", draw_autoencoder_loss, train_ae),
        ("loss_dsnet", draw_predictor_losses, *of_dsnet, train),
        ("loss_plus", draw_predictor_losses, *of_plus, has_losses and plus),
    ]
    return [Figure(name, draw, arguments) for name, draw, *arguments in planned if arguments[-1]]


def _unseen(scene: Scene) -> MotionSequence | None:
    """The first test sequence of the hardest group that the run has."""
    predicted, easiest_first = scene.predicted(), list(CELLS)
    tested = [
        one
        for one in scene.stages["evaluate"].manifest["per_sequence"]
        if one["split"] == "test" and one["name"] in predicted
    ]
    hardest = max(tested, key=lambda one: easiest_first.index(one["cell"]), default=None)
    return hardest and predicted[hardest["name"]]


def _subjects_of_figure9(scene: Scene) -> dict[str, tuple[MotionSequence | None, ...]]:
    """By motion, a sequence of a training subject and one of a test subject.

    Two motions are of kinds that training has seen, two are not: the paper's where the run has
    them, then those of the most people, new ones first; MoSh's `misc`, which is another motion of
    everybody, last. A note tells which of the four groups the run has no sequence of.
    """
    predicted = scene.predicted()
    by_motion: dict[str, dict[str, MotionSequence]] = {}
    unseen: set[str] = set()
    for one in scene.stages["evaluate"].manifest["per_sequence"]:
        if one["split"] != "train" and one["name"] in predicted:
            sequence = predicted[one["name"]]
            kind = kind_of(sequence.motion)
            by_motion.setdefault(kind, {}).setdefault(one["person"], sequence)
            if one["cell"].endswith("unseen_motion"):
                unseen.add(kind)

    def rank(kind: str) -> tuple[int, ...]:
        papers = FIGURE9_MOTIONS.index(kind) if kind in FIGURE9_MOTIONS else len(FIGURE9_MOTIONS)
        return papers, kind == "misc", -len(by_motion[kind]), "new" not in by_motion[kind]

    ranked = sorted(by_motion, key=rank)
    groups = [[kind for kind in ranked if (kind in unseen) is is_new] for is_new in (False, True)]
    half = len(FIGURE9_MOTIONS) // 2
    chosen = [kind for kinds in groups for kind in kinds[:half]]
    missing = [
        f"{person} people in {motions} motions"
        for motions, kinds in zip(("known", "unseen"), groups, strict=True)
        for person in ("known", "new")
        if not any(person in by_motion[kind] for kind in kinds)
    ]
    if by_motion and missing:
        notify(f"Figure 9 is without {', '.join(missing)}: the run has no such sequence")
    return {
        kind.replace("_", " "): (by_motion[kind].get("known"), by_motion[kind].get("new"))
        for kind in chosen
    }


def _sequence_of_figure10(scene: Scene) -> MotionSequence | None:
    """The paper's sequence of Figure 10, or another one of the same motion."""
    motion = ABSORBING_SEQUENCE.partition("_")[2]
    aligned = scene.pipelines[0].align.sequences
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
        label: unpack_theta(arrays.frames("theta", sequence.name, slice(None)))[0][:, joint]
        for label, arrays in motions.items()
    }
    title = f"Figure 10: rotation vector of {ABSORBING_JOINT}, {sequence.name}"
    draw_figure10(path, turns, fps=sequence.fps, title=title, origin=scene.origin)
