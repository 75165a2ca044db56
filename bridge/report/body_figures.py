"""Figures 4 and 7 of the paper, and a test motion, as rendered bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.measure.predictions import AUTOENCODER
from bridge.motion import MotionSequence
from bridge.report.motion_strip import draw_row_of_bodies
from bridge.report.panels import draw_panels, magnitude_colours, scale_top_m
from bridge.report.render import Camera, frame_camera, render_bodies
from bridge.report.scene import Scene

_STRIP_BODIES = 8


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: original mesh, the autoencoder's reconstruction, distance between the two."""
    frames, road = _lively_frames(scene, sequence, 2), scene.roads[0]
    aligned_m = scene.aligned_offsets_m(road, sequence.name, frames)
    rebuilt_m = scene.offsets_m(AUTOENCODER, sequence.name, frames)
    original, rebuilt = (scene.pose(road, sequence.name, frames, o) for o in (aligned_m, rebuilt_m))
    error_m = np.linalg.norm(rebuilt - original, axis=-1)
    top_m = scale_top_m(error_m)
    camera = frame_camera([*original, *rebuilt], height_px=scene.panel_px)
    rows = [
        [
            _picture(scene, camera, original[row]),
            _picture(scene, camera, rebuilt[row]),
            _picture(scene, camera, rebuilt[row], magnitude_colours(error_m[row], top_m)),
        ]
        for row in range(len(frames))
    ]
    draw_panels(
        path,
        rows,
        title="Figure 4: the autoencoder's reconstruction",
        origin=scene.origin,
        column_titles=["original mesh", "reconstruction", "per-vertex error"],
        row_titles=[_row_title(sequence, frame) for frame in frames],
        colour_top_m=top_m,
        colour_label="error",
        width_in=7.0,
    )


def draw_figure7(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 7: ground truth, SMPL alone, and for each road SMPL with its predictor and its part.

    Two roads have two rows instead of three, so that the picture takes as long to render.
    """
    frames = _lively_frames(scene, sequence, 4 - len(scene.roads))
    name, first = sequence.name, scene.roads[0]
    aligned_m = scene.aligned_offsets_m(first, name, frames)
    truth, plain = (scene.pose(first, name, frames, o) for o in (aligned_m, None))
    parts_m = [scene.offsets_m(road.default, name, frames) for road in scene.roads]
    moved = [
        scene.pose(road, name, frames, part_m)
        for road, part_m in zip(scene.roads, parts_m, strict=True)
    ]
    magnitudes_m = np.linalg.norm(parts_m, axis=-1)
    top_m = scale_top_m(magnitudes_m)
    camera = frame_camera([*truth, *plain, *np.concatenate(moved)], height_px=scene.panel_px)
    rows = []
    for row in range(len(frames)):
        pictures = [_picture(scene, camera, bodies[row]) for bodies in (truth, plain)]
        for bodies, magnitude_m in zip(moved, magnitudes_m, strict=True):
            colours = magnitude_colours(magnitude_m[row], top_m)
            pictures.append(_picture(scene, camera, bodies[row]))
            pictures.append(_picture(scene, camera, bodies[row], colours))
        rows.append(pictures)
    columns = ["ground truth", "SMPL"]
    for label in scene.shown.values():
        columns += [f"SMPL + {label}", f"part of {label}"]
    draw_panels(
        path,
        rows,
        title=f"Figure 7: a sequence that no predictor saw, {name}",
        origin=scene.origin,
        column_titles=[f"({'abcdef'[i]}) {title}" for i, title in enumerate(columns)],
        row_titles=[_row_title(sequence, frame) for frame in frames],
        colour_top_m=top_m,
        colour_label="contribution",
        width_in=9.0 + 2.0 * (len(scene.roads) - 1),
    )


def draw_test_strip(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """A motion, and if possible a subject, that no network has seen (compare Figure 9).

    With two roads, both at each moment side by side, on one scale of colour.
    """
    moments = _STRIP_BODIES // len(scene.roads)
    frames = np.linspace(0, sequence.length - 1, moments).round().astype(int)
    bodies, magnitudes_m = [], []
    for road in scene.roads:
        offsets_m = scene.offsets_m(road.default, sequence.name, frames)
        bodies.append(scene.pose(road, sequence.name, frames, offsets_m))
        magnitudes_m.append(np.linalg.norm(offsets_m, axis=-1))
    titles = list(scene.shown.values())
    times = [_row_title(sequence, frame) for frame in frames]
    shown = titles[0] if len(titles) == 1 else "both roads"
    draw_row_of_bodies(
        path,
        np.concatenate(np.stack(bodies, axis=1)),
        np.concatenate(np.stack(magnitudes_m, axis=1)),
        scene.body.faces,
        labels=times
        if len(titles) == 1
        else [f"{time}\n{title}" for time in times for title in titles],
        origin=scene.origin,
        title=f"Predicted skin offsets of an unseen motion, {sequence.name}: {shown}",
        width_px=int(4.4 * scene.panel_px),
    )


def _lively_frames(scene: Scene, sequence: MotionSequence, count: int) -> NDArray[np.int64]:
    """In each of `count` equal parts of a sequence, the frame with the largest true offset."""
    parts = np.array_split(np.arange(sequence.length), min(count, sequence.length))
    chosen = []
    for part in parts:
        offsets_m = scene.aligned_offsets_m(scene.roads[0], sequence.name, part)
        energy = [float(np.square(offset_m, dtype=np.float64).sum()) for offset_m in offsets_m]
        chosen.append(part[int(np.argmax(energy))])
    return np.array(chosen)


def _picture(
    scene: Scene, camera: Camera, body: NDArray, colours: NDArray | None = None
) -> NDArray[np.uint8]:
    return render_bodies([body], scene.body.faces, camera=camera, colours=[colours])


def _row_title(sequence: MotionSequence, frame: int) -> str:
    return f"{frame / sequence.fps:.2f} s"
