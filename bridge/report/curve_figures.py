"""Figures 6 and 8 of the paper, and the losses, as curves."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from bridge.measure.predictions import PERSON_MEAN, SMPL
from bridge.measure.stage_evaluate import frame_errors_m
from bridge.motion import MotionSequence, sequences_of
from bridge.paper import CLIP_FRAMES
from bridge.report.panels import new_figure, save_figure
from bridge.runs import Artifact

# Okabe and Ito's colours, told apart by every reader; line styles do it in print.
_TRAINED = ("#0072B2", "#56B4E9", "#CC79A7", "#009E73", "#D55E00", "#F0E442")
_LINES = ("-", "-.", ":")
_UNTRAINED = {PERSON_MEAN: ("#E69F00", "--"), SMPL: ("#777777", "-")}


def draw_figure6(path: Path, align: Artifact) -> None:
    """Figure 6: histogram of the sequences' lengths, and the length that all are brought to."""
    lengths = [sequence.length for sequence in sequences_of(align)]
    figure = new_figure(6.5, 3.6, title="Figure 6: lengths of the sequences", origin=align.origin)
    axes = figure.subplots()
    edges = np.arange(0, max(*lengths, CLIP_FRAMES) + 100, 50)
    axes.hist(lengths, bins=edges.tolist(), color="#0072B2", edgecolor="white")
    axes.axvline(CLIP_FRAMES, color="#D55E00", linestyle="--")
    axes.annotate(
        f"{CLIP_FRAMES} frames",
        (CLIP_FRAMES, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(4, -4),
        textcoords="offset points",
        verticalalignment="top",
        color="#D55E00",
        fontsize=9,
    )
    axes.set_xlim(left=0)
    # Room for the label above the bars.
    axes.margins(y=0.15)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    finish_axes(axes, "frames", "sequences", legend=False)
    save_figure(figure, path)


def draw_figure8(path: Path, evaluate: Artifact, sequence: MotionSequence) -> None:
    """Figure 8: error of the posed mesh in each frame, averaged over its vertices."""
    figure = new_figure(
        8.0,
        3.9,
        title=f"Figure 8: error over time, {sequence.name} (never trained on)",
        origin=evaluate.origin,
    )
    axes = figure.subplots()
    times_s = np.arange(sequence.length) / sequence.fps
    for name, (colour, line) in _styles(evaluate).items():
        error_m = frame_errors_m(evaluate, name, sequence.name)
        if error_m is not None:
            label = f"{evaluate.manifest['predictors'][name]}, mean {1e3 * error_m.mean():.2f} mm"
            axes.plot(times_s, 1e3 * error_m, line, color=colour, label=label, linewidth=1.5)
    axes.set_ylim(bottom=0.0, top=1.35 * axes.get_ylim()[1])  # room for the legend
    axes.set_xlim(times_s[0], times_s[-1] or 1.0)
    finish_axes(axes, "time [s]", "mean vertex error [mm]")
    save_figure(figure, path)


def trained_styles(evaluate: Artifact) -> dict[str, tuple[str, str]]:
    """Colour and line of each trained predictor, in the order of the tables."""
    roads = evaluate.manifest["roads"].values()
    trained = {name for road in roads for name in road["predictors"]}
    names = [name for name in evaluate.manifest["predictors"] if name in trained]
    return dict(zip(names, zip(cycle(_TRAINED), cycle(_LINES), strict=False), strict=False))


def _styles(evaluate: Artifact) -> dict[str, tuple[str, str]]:
    """Colour and line of each predictor that is drawn, the default one last and so on top."""
    return dict(reversed((trained_styles(evaluate) | _UNTRAINED).items()))


def draw_autoencoder_loss(path: Path, train_ae: Artifact) -> None:
    """Losses of the autoencoder; validation begins before the first step."""
    losses, validation, steps = (
        np.asarray(train_ae.array(name)) for name in ("loss", "validation_loss", "validation_steps")
    )
    figure = new_figure(
        6.5, 3.6, title="Loss of the autoencoder (mean squared error)", origin=train_ae.origin
    )
    axes = figure.subplots()
    marker = "o" if len(steps) < 20 else ""
    axes.plot(steps[1:], losses, marker=marker, color="#0072B2", label="training")
    axes.plot(steps, validation, "--", marker=marker, color="#D55E00", label="validation")
    _logarithmic(axes, np.concatenate([losses, validation]))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish_axes(axes, "step", "loss of normalised offsets")
    save_figure(figure, path)


def draw_dsnet_loss(path: Path, train: Artifact) -> None:
    """Losses of each predictor; their units differ, so each has axes of its own."""
    predictors = train.manifest["predictors"]
    figure = new_figure(
        4.4 * len(predictors), 3.6, title="Loss of DSNet (Section 4.3)", origin=train.origin
    )
    validated = np.asarray(train.array("validation_epochs"))
    panels = figure.subplots(1, len(predictors), squeeze=False)[0]
    for axes, (name, one) in zip(panels, predictors.items(), strict=True):
        loss = np.asarray(train.array(f"loss_{name}"))
        validation = np.asarray(train.array(f"validation_loss_{name}"))
        axes.plot(1 + np.arange(len(loss)), loss, color="#0072B2", label="training", linewidth=1)
        axes.plot(validated, validation, "--", color="#D55E00", label="validation")
        axes.set_title(f"{one['label']}, Adam {one['lr']:g}", fontsize=9)
        _logarithmic(axes, np.concatenate([loss, validation]))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        finish_axes(axes, "epoch", "loss of a sequence")
    save_figure(figure, path)


def draw_plus_loss(path: Path, train_plus: Artifact) -> None:
    """Losses of the best road's predictors, over the steps that were recorded."""
    losses = plus_losses(train_plus)
    figure = new_figure(
        6.5, 3.6, title="Loss of the best road's predictors", origin=train_plus.origin
    )
    axes = figure.subplots()
    for (name, loss), (colour, line) in zip(
        losses.items(), zip(cycle(_TRAINED), cycle(_LINES), strict=False), strict=False
    ):
        label = train_plus.manifest["predictors"][name]["label"]
        axes.plot(1 + np.arange(len(loss)), loss, line, color=colour, label=label)
    _logarithmic(axes, np.concatenate(list(losses.values())))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish_axes(axes, "step", "loss")
    save_figure(figure, path)


def plus_losses(train_plus: Artifact) -> dict[str, np.ndarray]:
    """The recorded losses by predictor; one that is solved for in one go has none."""
    return {
        name: np.asarray(train_plus.array(f"loss_{name}"))
        for name in train_plus.manifest["predictors"]
        if f"loss_{name}" in train_plus.manifest["arrays"]
    }


def _logarithmic(axes: Axes, values: np.ndarray) -> None:
    positive = np.isfinite(values).all() and (values > 0).all()
    if positive and values.max() > 10 * values.min():
        axes.set_yscale("log")


def finish_axes(axes: Axes, x: str, y: str, *, legend: bool = True) -> None:
    """Labels, grid and legend as all curves have them."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if legend:
        axes.legend(fontsize=8, frameon=False)
