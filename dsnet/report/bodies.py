"""Figures 1, 2, 4, 7 and 9 of the paper, as rendered bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.body.posing import rest_vertices, shaped_vertices
from bridge.motion import MotionSequence, unpack_theta
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin
from dsnet.evaluation.pipelines import AUTOENCODER, MotionArrays, Pipeline, pipelines_of
from dsnet.pictures.panels import draw_panels, magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.pictures.skins import skin_of

_FIGURE1_BODIES = 7
"""Bodies in each row of Figure 1, spread over the motion."""
_FIGURE9_BODIES = 3
"""Bodies of one subject in a row of Figure 9."""
Series = tuple[str, NDArray[np.float64], "NDArray[np.floating] | None"]
"""One column of a figure (a row in Figure 1): its title, posed bodies (N, V, 3), and the magnitudes
(N, V) that colour them, None for a plain body; metres."""
Panel = tuple[NDArray[np.float64], "NDArray[np.floating] | None"]
"""A posed body (V, 3) and the magnitudes (V,) that colour it, None for a plain body; metres."""


@dataclass(frozen=True)
class Scene:
    """The data that figures of bodies draw: a run's artifacts and the body it was aligned with."""

    stages: Mapping[str, Artifact]
    """Artifacts by stage."""
    body: BodyModelData
    panel_px: int = 300
    """Height of one rendered body."""

    @property
    def origin(self) -> DataOrigin:
        return self.stages["evaluate"].origin

    @cached_property
    def pipelines(self) -> list[Pipeline]:
        """The run's pipelines, the paper's first."""
        return pipelines_of(self.stages)

    def predicted(self) -> dict[str, MotionSequence]:
        """The sequences that every pipeline has predicted, by name."""
        first, *others = (pipeline.offsets.sequences for pipeline in self.pipelines)
        return {name: s for name, s in first.items() if all(name in other for other in others)}

    def pose(
        self, motions: MotionArrays, name: str, frames: NDArray, offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """Bodies (N, V, 3) in some frames of a sequence, without their travel along the floor."""
        pose, trans = unpack_theta(motions.frames("theta", name, frames))
        shapes = np.repeat(motions.betas(name)[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans * [0.0, 1.0, 0.0], offsets_m)

    def predicted_series(self, pipeline: Pipeline, name: str, frames: NDArray) -> Series:
        """Bodies with the offsets of a pipeline's default predictor, coloured by their length."""
        offsets_m = pipeline.predicted_m(pipeline.default, name, frames)
        posed = self.pose(pipeline.motions, name, frames, offsets_m)
        return pipeline.predictors[pipeline.default], posed, np.linalg.norm(offsets_m, axis=-1)


def draw_figure1(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 1: an unseen motion over time, of a test subject if the run has one.

    The first row is SMPL alone, the others are the predictions of each pipeline.
    """
    frames = np.linspace(0, sequence.length - 1, _FIGURE1_BODIES + 1).round().astype(int)[1:]
    name, first = sequence.name, scene.pipelines[0]
    rows: list[Series] = [("SMPL", scene.pose(first.motions, name, frames, None), None)]
    rows += [scene.predicted_series(pipeline, name, frames) for pipeline in scene.pipelines]
    title = f"Figure 1: skin offsets of an unseen motion, {name}"
    _draw(
        path,
        scene,
        [_panels(row) for row in rows],
        column_titles=_times(sequence, frames),
        row_titles=[label for label, *_ in rows],
        title=title,
        colour_label="skin offset",
        width_in=10.0,
    )


def draw_figure2(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 2: a mesh, the mesh unposed, SMPL's shape, SMPL posed, and SMPL with the offsets."""
    frames, first, name = lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    offsets_m = first.align.frames("offsets", name, frames)
    fitted, plain = (scene.pose(first.align, name, frames, o) for o in (offsets_m, None))
    pose, _ = unpack_theta(first.align.frames("theta", name, frames))
    shapes = np.repeat(first.align.betas(name)[None], len(frames), axis=0)
    unposed = rest_vertices(scene.body, shapes, pose) + offsets_m
    shaped = shaped_vertices(scene.body, shapes)
    # Put the bodies in the rest pose on the same floor as the posed ones.
    rise_m = np.array([0.0, fitted[..., 1].min() - shaped[..., 1].min(), 0.0])
    columns: list[Series] = [
        ("(a) S", fitted, None),
        ("(b) W⁻¹(S)", unposed + rise_m, None),
        ("(c) M(β)", shaped + rise_m, None),
        ("(d) M(β, θ)", plain, None),
        ("(e) M(β, θ) + Δ", fitted, np.linalg.norm(offsets_m, axis=-1)),
    ]
    title = f"Figure 2: alignment of {name}"
    titles = _times(sequence, frames)
    _draw_columns(path, scene, columns, titles, title=title, colour_label="Δ", width_in=10.0)


def draw_figure9(
    path: Path, scene: Scene, shown: Mapping[str, Sequence[MotionSequence | None]]
) -> None:
    """Figure 9: motions of a training subject and of a test subject, whose bodies are framed.

    Parameters
    ----------
    shown : by row title, the sequence of the training subject and that of the test subject; None
        where the run has none.
    """
    pipeline = scene.pipelines[0]

    def panels_of(one: MotionSequence | None) -> Sequence[Panel | None]:
        if one is None:
            return [None] * _FIGURE9_BODIES
        frames = np.linspace(0, one.length - 1, _FIGURE9_BODIES + 2).round().astype(int)[1:-1]
        return _panels(scene.predicted_series(pipeline, one.name, frames))

    rows = [[panel for one in pair for panel in panels_of(one)] for pair in shown.values()]
    framed = [
        (row, column)
        for row, panels in enumerate(rows)
        for column in range(_FIGURE9_BODIES, len(panels))
        if panels[column]
    ]
    title = f"Figure 9: {pipeline.predictors[pipeline.default]}, known and (framed) new people"
    _draw(
        path,
        scene,
        rows,
        column_titles=["", "known", "", "", "new", ""],
        row_titles=list(shown),
        title=title,
        colour_label="skin offset",
        width_in=9.0,
        framed=framed,
    )


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: aligned meshes, the autoencoder's reconstruction of them, and its error."""
    frames, first, name = lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    aligned_m = first.align.frames("offsets", name, frames)
    reconstructed_m = first.predicted_m(AUTOENCODER, name, frames)
    original, reconstructed = (
        scene.pose(first.motions, name, frames, o) for o in (aligned_m, reconstructed_m)
    )
    columns: list[Series] = [
        ("original mesh", original, None),
        ("reconstruction", reconstructed, None),
        ("per-vertex error", reconstructed, np.linalg.norm(reconstructed - original, axis=-1)),
    ]
    title, titles = "Figure 4: the autoencoder's reconstruction", _times(sequence, frames)
    _draw_columns(path, scene, columns, titles, title=title, colour_label="error", width_in=7.0)


def draw_figure7(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 7: ground truth, SMPL alone, and each pipeline's prediction with its contribution.

    With two pipelines there are two rows instead of three, so that rendering takes as long.
    """
    frames = lively_frames(scene, sequence, 4 - len(scene.pipelines))
    name, first = sequence.name, scene.pipelines[0]
    aligned_m = first.align.frames("offsets", name, frames)
    truth, plain = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, None))
    letters = iter("cdef")
    columns: list[Series] = [("(a) ground truth", truth, None), ("(b) SMPL", plain, None)]
    for pipeline in scene.pipelines:
        label, predicted, sizes_m = scene.predicted_series(pipeline, name, frames)
        columns.append((f"({next(letters)}) SMPL + {label}", predicted, None))
        columns.append((f"({next(letters)}) part of {label}", predicted, sizes_m))
    title = f"Figure 7: a sequence that no predictor saw, {name}"
    look = {"colour_label": "contribution", "width_in": 9.0 + 2.0 * (len(scene.pipelines) - 1)}
    _draw_columns(path, scene, columns, _times(sequence, frames), title=title, **look)


def _panels(series: Series) -> list[Panel]:
    _, posed, sizes_m = series
    return list(zip(posed, [None] * len(posed) if sizes_m is None else sizes_m, strict=True))


def _draw_columns(
    path: Path, scene: Scene, columns: Sequence[Series], row_titles: Sequence[str], **look: Any
) -> None:
    """Draw a figure that is given by its columns; `look` is for `draw_panels`."""
    rows, titles = list(zip(*map(_panels, columns), strict=True)), [label for label, *_ in columns]
    _draw(path, scene, rows, column_titles=titles, row_titles=row_titles, **look)


def _draw(path: Path, scene: Scene, rows: Sequence[Sequence[Panel | None]], **look: Any) -> None:
    """Render the panels with one camera and one colour scale; None gives a white panel.

    `look` is for `draw_panels`.
    """
    shown = [panel for row in rows for panel in row if panel]
    top_m = scale_top_m([size_m for _, size_m in shown if size_m is not None])
    camera = frame_camera([body for body, _ in shown], height_px=scene.panel_px)

    def picture(panel: Panel | None) -> NDArray[np.uint8]:
        if panel is None:
            return np.full((camera.height_px, camera.width_px, 3), 255, np.uint8)
        body, size_m = panel
        colours = skin_of(scene.body) if size_m is None else magnitude_colours(size_m, top_m)
        return render_bodies([body], scene.body.faces, camera=camera, colours=[colours])

    pictures = [[picture(panel) for panel in row] for row in rows]
    draw_panels(path, pictures, origin=scene.origin, colour_top_m=top_m, **look)


def lively_frames(scene: Scene, sequence: MotionSequence, count: int) -> NDArray[np.int64]:
    """The frame with the largest true offsets in each of `count` equal parts of a sequence."""
    chosen = []
    for part in np.array_split(np.arange(sequence.length), min(count, sequence.length)):
        offsets_m = scene.pipelines[0].align.frames("offsets", sequence.name, part)
        energy = [float(np.square(offset_m, dtype=np.float64).sum()) for offset_m in offsets_m]
        chosen.append(part[int(np.argmax(energy))])
    return np.array(chosen)


def _times(sequence: MotionSequence, frames: NDArray[np.int64]) -> list[str]:
    return [f"{frame / sequence.fps:.2f} s" for frame in frames]
