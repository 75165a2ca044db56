"""Figures 4 and 7 of the paper, and a test motion, as rendered bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.measure.predictions import AUTOENCODER
from bridge.motion import MotionSequence
from bridge.report.motion_strip import draw_motion_strip
from bridge.report.panels import draw_panels, magnitude_colours, scale_top_m
from bridge.report.render import Camera, frame_camera, render_bodies
from bridge.report.scene import Scene

_STRIP_BODIES = 8


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: original mesh, the autoencoder's reconstruction, distance between the two."""
    frames = _lively_frames(scene, sequence, 2)
    aligned_m = scene.aligned_offsets_m(sequence.name, frames)
    rebuilt_m = scene.decoded_offsets_m(AUTOENCODER, sequence.name, frames)
    original, rebuilt = (scene.pose(sequence.name, frames, o) for o in (aligned_m, rebuilt_m))
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
    """Figure 7 (a-d): ground truth, SMPL alone, SMPL with DSNet, and what DSNet contributes."""
    frames = _lively_frames(scene, sequence, 3)
    predicted_m = scene.decoded_offsets_m(scene.default, sequence.name, frames)
    truth = scene.pose(sequence.name, frames, scene.aligned_offsets_m(sequence.name, frames))
    plain = scene.pose(sequence.name, frames, None)
    moved = scene.pose(sequence.name, frames, predicted_m)
    magnitude_m = np.linalg.norm(predicted_m, axis=-1)
    top_m = scale_top_m(magnitude_m)
    camera = frame_camera([*truth, *plain, *moved], height_px=scene.panel_px)
    rows = [
        [
            *(_picture(scene, camera, bodies[row]) for bodies in (truth, plain, moved)),
            _picture(scene, camera, moved[row], magnitude_colours(magnitude_m[row], top_m)),
        ]
        for row in range(len(frames))
    ]
    draw_panels(
        path,
        rows,
        title=f"Figure 7: DSNet on a sequence it never saw, {sequence.name}",
        origin=scene.origin,
        column_titles=["(a) ground truth", "(b) SMPL", "(c) SMPL + DSNet", "(d) DSNet's part"],
        row_titles=[_row_title(sequence, frame) for frame in frames],
        colour_top_m=top_m,
        colour_label="contribution",
    )


def draw_test_strip(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """A motion, and if possible a subject, that no network has seen (compare Figure 9)."""
    frames = np.linspace(0, sequence.length - 1, _STRIP_BODIES).round().astype(int)
    offsets_m = scene.decoded_offsets_m(scene.default, sequence.name, frames)
    # The frames are the strip's own choice already: their times follow from the mean step.
    draw_motion_strip(
        path,
        scene.pose(sequence.name, frames, offsets_m),
        offsets_m,
        scene.body.faces,
        origin=scene.origin,
        fps=sequence.fps * (len(frames) - 1) / max(sequence.length - 1, 1),
        title=f"Predicted skin offsets of an unseen motion, {sequence.name}",
        samples=scene.samples,
        width_px=int(4.4 * scene.panel_px),
    )


def _lively_frames(scene: Scene, sequence: MotionSequence, count: int) -> NDArray[np.int64]:
    """In each of `count` equal parts of a sequence, the frame with the largest true offset."""
    parts = np.array_split(np.arange(sequence.length), min(count, sequence.length))
    chosen = []
    for part in parts:
        offsets_m = scene.aligned_offsets_m(sequence.name, part)
        energy = [float(np.square(offset_m, dtype=np.float64).sum()) for offset_m in offsets_m]
        chosen.append(part[int(np.argmax(energy))])
    return np.array(chosen)


def _picture(
    scene: Scene, camera: Camera, body: NDArray, colours: NDArray | None = None
) -> NDArray[np.uint8]:
    return render_bodies(
        [body], scene.body.faces, camera=camera, colours=[colours], samples=scene.samples
    )


def _row_title(sequence: MotionSequence, frame: int) -> str:
    return f"{frame / sequence.fps:.2f} s"
