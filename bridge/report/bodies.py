"""Figures 4 and 7 of the paper, and a test motion, as rendered bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.measure.pipelines import AUTOENCODER, Pipeline, pipeline_of, pipelines_of
from bridge.motion import MotionSequence, unpack_theta
from bridge.report.panels import draw_panels, draw_row_of_bodies, magnitude_colours, scale_top_m
from bridge.report.render import Camera, frame_camera, render_bodies
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin

_STRIP_BODIES = 8
Column = tuple[str, NDArray[np.float64], "NDArray[np.floating] | None"]
"""Title, posed bodies (N, V, 3), and if they are coloured by it, a size (N, V); metres."""


@dataclass(frozen=True)
class Scene:
    """What the figures draw: a run's stages, its pipelines, its body, posed frames of sequences."""

    stages: Mapping[str, Artifact]
    """Artifacts by stage."""
    body: BodyModelData
    """The body that the run was aligned with."""
    panel_px: int = 300
    """Height of one rendered body."""

    @property
    def origin(self) -> DataOrigin:
        return self.stages["evaluate"].origin

    @cached_property
    def pipelines(self) -> list[Pipeline]:
        """The paper's first."""
        return pipelines_of(self.stages)

    @property
    def shown(self) -> dict[str, str]:
        """Predictors that are drawn, one a pipeline, with their labels."""
        return {one.default: one.predictors[one.default] for one in self.pipelines}

    def predicted(self) -> dict[str, MotionSequence]:
        """Sequences that every pipeline has predicted, by name."""
        first, *others = (pipeline.offsets.places for pipeline in self.pipelines)
        return {name: s for name, s in first.items() if all(name in other for other in others)}

    def offsets_m(self, predictor: str, name: str, frames: NDArray) -> NDArray[np.float32]:
        """(N, V, 3) offsets that a predictor, or the autoencoder, gives for a sequence."""
        first = predictor == AUTOENCODER
        pipeline = self.pipelines[0] if first else pipeline_of(self.pipelines, predictor)
        return pipeline.offsets.frames(f"offsets_{predictor}", name, frames)

    def pose(
        self, pipeline: Pipeline, name: str, frames: NDArray, offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """(N, V, 3) bodies in a pipeline's motion, without their travel along the floor."""
        motions = pipeline.motions
        pose, trans = unpack_theta(motions.frames("theta", name, frames))
        shapes = np.repeat(motions.betas(name)[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans * [0.0, 1.0, 0.0], offsets_m)

    def picture(
        self, camera: Camera, body: NDArray, colours: NDArray | None = None
    ) -> NDArray[np.uint8]:
        """One body (V, 3), perhaps in colours (V, 3)."""
        return render_bodies([body], self.body.faces, camera=camera, colours=[colours])


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: aligned meshes, what the autoencoder makes of them, and its error."""
    frames, first, name = _lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    aligned_m = first.align.frames("offsets", name, frames)
    rebuilt_m = scene.offsets_m(AUTOENCODER, name, frames)
    original, rebuilt = (scene.pose(first, name, frames, o) for o in (aligned_m, rebuilt_m))
    error_m = np.linalg.norm(rebuilt - original, axis=-1)
    columns: list[Column] = [
        ("original mesh", original, None),
        ("reconstruction", rebuilt, None),
        ("per-vertex error", rebuilt, error_m),
    ]
    title = "Figure 4: the autoencoder's reconstruction"
    _draw_columns(path, scene, _times(sequence, frames), columns, title, "error", 7.0)


def draw_figure7(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 7: ground truth, SMPL alone, SMPL with each pipeline's predictor, and its part.

    Two pipelines have two rows instead of three, so that the picture takes as long to render.
    """
    frames = _lively_frames(scene, sequence, 4 - len(scene.pipelines))
    name, first = sequence.name, scene.pipelines[0]
    aligned_m = first.align.frames("offsets", name, frames)
    truth, plain = (scene.pose(first, name, frames, o) for o in (aligned_m, None))
    letters = iter("cdef")
    columns: list[Column] = [("(a) ground truth", truth, None), ("(b) SMPL", plain, None)]
    for pipeline in scene.pipelines:
        part_m = scene.offsets_m(pipeline.default, name, frames)
        moved = scene.pose(pipeline, name, frames, part_m)
        label = pipeline.predictors[pipeline.default]
        columns.append((f"({next(letters)}) SMPL + {label}", moved, None))
        part = np.linalg.norm(part_m, axis=-1)
        columns.append((f"({next(letters)}) part of {label}", moved, part))
    title = f"Figure 7: a sequence that no predictor saw, {name}"
    width_in = 9.0 + 2.0 * (len(scene.pipelines) - 1)
    _draw_columns(path, scene, _times(sequence, frames), columns, title, "contribution", width_in)


def _draw_columns(
    path: Path,
    scene: Scene,
    times: Sequence[str],
    columns: Sequence[Column],
    title: str,
    colour_label: str,
    width_in: float,
) -> None:
    """A picture for each time and column, on one scale of colour."""
    top_m = scale_top_m([sizes_m for *_, sizes_m in columns if sizes_m is not None])
    everything = np.concatenate([posed for _, posed, _ in columns])
    camera = frame_camera(list(everything), height_px=scene.panel_px)
    rows: list[list[NDArray[np.uint8]]] = []
    for row in range(len(times)):
        colours = [None if m is None else magnitude_colours(m[row], top_m) for *_, m in columns]
        bodies = [posed[row] for _, posed, _ in columns]
        rows.append([scene.picture(camera, *one) for one in zip(bodies, colours, strict=True)])
    draw_panels(
        path,
        rows,
        title=title,
        origin=scene.origin,
        column_titles=[column_title for column_title, *_ in columns],
        row_titles=times,
        colour_top_m=top_m,
        colour_label=colour_label,
        width_in=width_in,
    )


def draw_test_strip(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """A motion, and if possible a subject, that no network has seen (compare Figure 9).

    With two pipelines, both at each moment side by side, on one scale of colour.
    """
    titles = list(scene.shown.values())
    frames = np.linspace(0, sequence.length - 1, _STRIP_BODIES // len(titles)).round().astype(int)
    bodies, magnitudes_m = [], []
    for pipeline in scene.pipelines:
        offsets_m = scene.offsets_m(pipeline.default, sequence.name, frames)
        bodies.append(scene.pose(pipeline, sequence.name, frames, offsets_m))
        magnitudes_m.append(np.linalg.norm(offsets_m, axis=-1))
    labels = _times(sequence, frames)
    shown = titles[0]
    if len(titles) > 1:
        labels = [f"{time}\n{title}" for time in labels for title in titles]
        shown = "both pipelines"
    draw_row_of_bodies(
        path,
        np.concatenate(np.stack(bodies, axis=1)),
        np.concatenate(np.stack(magnitudes_m, axis=1)),
        scene.body.faces,
        labels=labels,
        origin=scene.origin,
        title=f"Predicted skin offsets of an unseen motion, {sequence.name}: {shown}",
        width_px=int(4.4 * scene.panel_px),
    )


def _lively_frames(scene: Scene, sequence: MotionSequence, count: int) -> NDArray[np.int64]:
    """In each of `count` equal parts of a sequence, the frame with the largest true offset."""
    chosen = []
    for part in np.array_split(np.arange(sequence.length), min(count, sequence.length)):
        offsets_m = scene.pipelines[0].align.frames("offsets", sequence.name, part)
        energy = [float(np.square(offset_m, dtype=np.float64).sum()) for offset_m in offsets_m]
        chosen.append(part[int(np.argmax(energy))])
    return np.array(chosen)


def _times(sequence: MotionSequence, frames: NDArray[np.int64]) -> list[str]:
    return [f"{frame / sequence.fps:.2f} s" for frame in frames]
