"""One motion under several systems: a row of bodies each, drawn of a finished run."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.motion import sequences_of
from bridge.runs import Run
from bridge.runs.run import body_model_path
from dsnet.evaluation.pipelines import stages_of_pipelines
from dsnet.pictures.panels import draw_panels, magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.report.bodies import Scene

SHOWN = ("dsnet_plus", "softsmpl_like", "dyna_like", "casas_otaduy_like", "dsnet_faithful")
"""Systems that get a row if the run has them; more would not be seen."""
_COLUMNS = 6
_TRUE = "simulated truth"


def draw_clips(path: Path, run: Run, name: str) -> None:
    """Write a PNG of the sequence `name`: the truth above, a row for each system below.

    Frames are the liveliest of equal parts; colour is the size of the offsets, on one scale.
    """
    stages = run.artifacts(*stages_of_pipelines(run), "truth", "evaluate")
    scene = Scene(stages, load_body_model(str(body_model_path(run))), panel_px=220)
    frames, true_m = _liveliest(scene, name)
    rows = {_TRUE: true_m}
    rows |= {
        one.predictors[system]: one.predicted_m(system, name, frames)
        for system in SHOWN
        for one in scene.pipelines
        if system in one.predictors
    }
    top_m = scale_top_m(np.linalg.norm(true_m, axis=-1))
    posed = {
        label: scene.pose(scene.pipelines[-1].motions, name, frames, rows_m)
        for label, rows_m in rows.items()
    }
    camera = frame_camera(list(posed[_TRUE]), height_px=scene.panel_px)
    sizes_m = {label: np.linalg.norm(rows_m, axis=-1) for label, rows_m in rows.items()}
    colours = {label: magnitude_colours(one, top_m) for label, one in sizes_m.items()}
    pictures = [
        [
            render_bodies([body], scene.body.faces, camera=camera, colours=[paint])
            for body, paint in zip(posed[n], colours[n], strict=True)
        ]
        for n in rows
    ]
    fps = next(s.fps for s in sequences_of(stages["truth"]) if s.name == name)
    draw_panels(
        path,
        pictures,
        title=f"{name}, new to all: the true offsets, and what systems make of the motion",
        origin=scene.origin,
        column_titles=[f"{frame / fps:.2f} s" for frame in frames],
        row_titles=[fill(label.partition(",")[0], 16) for label in rows],
        colour_top_m=top_m,
        colour_label="offset",
    )


def _liveliest(scene: Scene, name: str) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """In each of equal parts the frame with the largest true offsets, and those (N, V, 3)."""
    truth = scene.stages["truth"]
    place = next(s for s in sequences_of(truth) if s.name == name)
    true_m = truth.array("offsets")[place.frames]
    energy = np.square(true_m, dtype=np.float64).sum((1, 2))
    parts = np.array_split(np.arange(place.length), min(_COLUMNS, place.length))
    frames = np.array([part[np.argmax(energy[part])] for part in parts])
    return frames, np.asarray(true_m[frames])
