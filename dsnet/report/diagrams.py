"""Figures 3 and 5 of the paper: diagrams of the networks that a run has trained."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Rectangle

from bridge.exchange import load_weights
from bridge.paper import FEATURES, LATENT_SIZE
from bridge.runs import Artifact
from dsnet.pictures.panels import new_figure, save_figure

_DATA, _LINEAR, _CONV, _LSTM = "#C9CED6", "#56B4E9", "#E69F00", "#009E73"


def draw_figure3(path: Path, train_ae: Artifact) -> None:
    """Figure 3: the autoencoder's layers, with its data as grey boxes of vertices by features."""
    sizes = sizes_of(train_ae.manifest["architecture"]["widths"])
    linear = len(FEATURES) - 1
    layers = ["linear"] * linear + ["Conv1d"] * (len(sizes) - 1 - linear)
    mirrored = [*sizes, None, *sizes[::-1]]
    named = [*layers, "linear", "linear", *layers[::-1]]
    count = train_ae.manifest["parameters"]["mesh_autoencoder"]
    title = f"Figure 3: the mesh autoencoder, {count:,} parameters"
    figure = new_figure(10.0, 3.6, title=title, origin=train_ae.origin)
    axes = figure.subplots()
    for place, size in enumerate(mirrored):
        # Box heights are logarithmic: on a linear scale 6,890 vertices would dwarf the rest.
        vertices, features = size or (LATENT_SIZE, 1)
        height, width = np.log10(vertices) / 4, 0.16 + 0.035 * features
        axes.add_patch(Rectangle((place - width / 2, -height / 2), width, height, fc=_DATA, ec="k"))
        axes.text(place, height / 2 + 0.03, f"{vertices:,}", ha="center", fontsize=8)
        label = f"x {features}" if size else "latents"
        axes.text(place, -height / 2 - 0.03, label, ha="center", va="top", fontsize=8)
    for place, layer in enumerate(named):
        colour = _CONV if layer == "Conv1d" else _LINEAR
        _arrow(axes, (place + 0.26, 0), (place + 0.74, 0), colour)
        axes.text(place + 0.5, -0.66, layer, ha="center", fontsize=7.5)
    middle = len(sizes)
    for where, word in ((middle / 2 - 0.5, "encoder"), (1.5 * middle + 0.5, "decoder")):
        axes.text(where, 0.68, word, ha="center", fontsize=10, weight="bold")
    axes.set(xlim=(-0.6, len(mirrored) - 0.4), ylim=(-0.72, 0.8))
    axes.set_axis_off()
    save_figure(figure, path)


def sizes_of(widths: Sequence[int]) -> list[tuple[int, int]]:
    """Vertices and features between the encoder's layers, from the mesh to its last layer's input.

    The decoder has the same sizes in reverse order.
    """
    sizes = [(widths[0], features) for features in FEATURES]
    return [*sizes, *((vertices, FEATURES[-1]) for vertices in widths[1:])]


def draw_figure5(path: Path, train: Artifact) -> None:
    """Figure 5: DSNet unrolled over three frames, with the widths of the trained weights."""
    weights = load_weights(train.file(f"{train.manifest['default']}.safetensors"))
    inputs, first = weights["fc_enc_1/kernel"].shape
    second, hidden = weights["fc_enc_2/kernel"].shape[1], weights["lstm/recurrent_kernel"].shape[0]
    boxes = [  # text, width of the input from below, colour
        ("$\\beta$, $\\theta_{{{t}}}$", "", _DATA),
        ("fc_enc_1, linear", inputs, _LINEAR),
        ("fc_enc_2, tanh", first, _LINEAR),
        ("LSTM", second, _LSTM),
        ("batch norm", hidden, _CONV),
        ("fc_enc_3, linear", hidden, _LINEAR),
        ("$\\tilde{{\\delta}}_{{{t}}}$", weights["fc_enc_3/kernel"].shape[1], _DATA),
    ]
    count = train.manifest["parameters"]["dsnet"]
    title = f"Figure 5: DSNet unrolled, {count:,} parameters"
    figure = new_figure(7.5, 5.4, title=title, origin=train.origin)
    axes = figure.subplots()
    for column, time in enumerate(("t-1", "t", "t+1")):
        for row, (text, width, colour) in enumerate(boxes):
            axes.add_patch(Rectangle((column - 0.3, row), 0.6, 0.55, fc=colour, ec="black", lw=0.8))
            label = text.format(t=time)
            axes.text(column, row + 0.27, label, ha="center", va="center", fontsize=9)
            if row:
                _arrow(axes, (column, row - 0.45), (column, row))
                axes.text(column + 0.05, row - 0.225, width, va="center", fontsize=8)
    lstm = 0.27 + [text for text, *_ in boxes].index("LSTM")
    for start in (-0.8, 0.3, 1.3, 2.3):
        _arrow(axes, (start, lstm), (start + (0.5 if start < 0 else 0.4), lstm))
    axes.text(0.5, lstm + 0.1, "state", ha="center", fontsize=8)
    axes.set(xlim=(-0.9, 2.9), ylim=(-0.2, len(boxes)))
    axes.set_axis_off()
    save_figure(figure, path)


def _arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str = "black"
) -> None:
    look = {"arrowstyle": "-|>", "mutation_scale": 11, "shrinkA": 0, "shrinkB": 0, "color": colour}
    axes.add_patch(FancyArrowPatch(start, end, **look))
