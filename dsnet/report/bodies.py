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
from dsnet.report.panels import draw_panels, magnitude_colours, scale_top_m
from dsnet.report.render import frame_camera, render_bodies

_ALONG = 7
"""Bodies of one motion in Figure 1."""
_OF_A_PERSON = 3
"""Bodies of one person in a row of Figure 9."""
Series = tuple[str, NDArray[np.float64], "NDArray[np.floating] | None"]
"""Title, posed bodies (N, V, 3), and if they are coloured by it, a size (N, V); metres. A column,
in Figure 1 a row."""
Cell = tuple[NDArray[np.float64], "NDArray[np.floating] | None"]
"""A posed body (V, 3), and if it is coloured by it, a size (V,); metres."""


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

    def predicted(self) -> dict[str, MotionSequence]:
        """Sequences that every pipeline has predicted, by name."""
        first, *others = (pipeline.offsets.places for pipeline in self.pipelines)
        return {name: s for name, s in first.items() if all(name in other for other in others)}

    def pose(
        self, motions: MotionArrays, name: str, frames: NDArray, offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """(N, V, 3) bodies of a motion and shape, without their travel along the floor."""
        pose, trans = unpack_theta(motions.frames("theta", name, frames))
        shapes = np.repeat(motions.betas(name)[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans * [0.0, 1.0, 0.0], offsets_m)

    def moved_by(self, pipeline: Pipeline, name: str, frames: NDArray) -> Series:
        """What a pipeline's default predictor is called, the bodies that it moves, and how far."""
        offsets_m = pipeline.predicted_m(pipeline.default, name, frames)
        moved = self.pose(pipeline.motions, name, frames, offsets_m)
        return pipeline.predictors[pipeline.default], moved, np.linalg.norm(offsets_m, axis=-1)


def draw_figure1(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 1: a motion, and if possible a subject, that no network has seen, along the time; the
    bodies that skeleton and shape give, and what each pipeline makes of them."""
    frames = np.linspace(0, sequence.length - 1, _ALONG + 1).round().astype(int)[1:]
    name, first = sequence.name, scene.pipelines[0]
    rows: list[Series] = [("SMPL", scene.pose(first.motions, name, frames, None), None)]
    rows += [scene.moved_by(pipeline, name, frames) for pipeline in scene.pipelines]
    cells = [_cells(row) for row in rows]
    title = f"Figure 1: skin offsets of an unseen motion, {name}"
    _draw(
        path,
        scene,
        cells,
        column_titles=_times(sequence, frames),
        row_titles=[label for label, *_ in rows],
        title=title,
        colour_label="skin offset",
        width_in=10.0,
    )


def draw_figure2(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 2: a mesh, unposed, SMPL's shape, its pose, and what is left over as the offset."""
    frames, first, name = _lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    offsets_m = first.align.frames("offsets", name, frames)
    fitted, plain = (scene.pose(first.align, name, frames, given) for given in (offsets_m, None))
    pose, _ = unpack_theta(first.align.frames("theta", name, frames))
    shapes = np.repeat(first.align.betas(name)[None], len(frames), axis=0)
    unposed = rest_vertices(scene.body, shapes, pose) + offsets_m
    shaped = shaped_vertices(scene.body, shapes)
    # The rest pose stands on the floor of the others.
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
    """Figure 9: motions, observed ones first, by a known person and by a new one, who is framed.

    Parameters
    ----------
    shown : by title of a row, the known person's sequence and the new person's, where there is one.
    """
    pipeline = scene.pipelines[0]

    def bodies_of(one: MotionSequence | None) -> Sequence[Cell | None]:
        if one is None:
            return [None] * _OF_A_PERSON
        frames = np.linspace(0, one.length - 1, _OF_A_PERSON + 2).round().astype(int)[1:-1]
        return _cells(scene.moved_by(pipeline, one.name, frames))

    cells = [[cell for one in pair for cell in bodies_of(one)] for pair in shown.values()]
    new = [(r, c) for r, row in enumerate(cells) for c in range(_OF_A_PERSON, len(row)) if row[c]]
    title = f"Figure 9: {pipeline.predictors[pipeline.default]}, known and (framed) new people"
    _draw(
        path,
        scene,
        cells,
        column_titles=["", "known", "", "", "new", ""],
        row_titles=list(shown),
        title=title,
        colour_label="skin offset",
        width_in=9.0,
        framed=new,
    )


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: aligned meshes, what the autoencoder makes of them, and its error."""
    frames, first, name = _lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    aligned_m = first.align.frames("offsets", name, frames)
    rebuilt_m = first.predicted_m(AUTOENCODER, name, frames)
    original, rebuilt = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, rebuilt_m))
    columns: list[Series] = [
        ("original mesh", original, None),
        ("reconstruction", rebuilt, None),
        ("per-vertex error", rebuilt, np.linalg.norm(rebuilt - original, axis=-1)),
    ]
    title, titles = "Figure 4: the autoencoder's reconstruction", _times(sequence, frames)
    _draw_columns(path, scene, columns, titles, title=title, colour_label="error", width_in=7.0)


def draw_figure7(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 7: ground truth, SMPL alone, SMPL with each pipeline's predictor, and its part.

    Two pipelines have two rows instead of three, so that the picture takes as long to render.
    """
    frames = _lively_frames(scene, sequence, 4 - len(scene.pipelines))
    name, first = sequence.name, scene.pipelines[0]
    aligned_m = first.align.frames("offsets", name, frames)
    truth, plain = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, None))
    letters = iter("cdef")
    columns: list[Series] = [("(a) ground truth", truth, None), ("(b) SMPL", plain, None)]
    for pipeline in scene.pipelines:
        label, moved, size_m = scene.moved_by(pipeline, name, frames)
        columns.append((f"({next(letters)}) SMPL + {label}", moved, None))
        columns.append((f"({next(letters)}) part of {label}", moved, size_m))
    title = f"Figure 7: a sequence that no predictor saw, {name}"
    look = {"colour_label": "contribution", "width_in": 9.0 + 2.0 * (len(scene.pipelines) - 1)}
    _draw_columns(path, scene, columns, _times(sequence, frames), title=title, **look)


def _cells(series: Series) -> list[Cell]:
    _, posed, sizes_m = series
    return list(zip(posed, [None] * len(posed) if sizes_m is None else sizes_m, strict=True))


def _draw_columns(
    path: Path, scene: Scene, columns: Sequence[Series], row_titles: Sequence[str], **look: Any
) -> None:
    """As `_draw`, of columns with their titles."""
    cells, titles = list(zip(*map(_cells, columns), strict=True)), [label for label, *_ in columns]
    _draw(path, scene, cells, column_titles=titles, row_titles=row_titles, **look)


def _draw(path: Path, scene: Scene, cells: Sequence[Sequence[Cell | None]], **look: Any) -> None:
    """As `draw_panels`, which has titles and `look`: a picture for each cell, on one scale of
    colour; white where there is none."""
    shown = [cell for row in cells for cell in row if cell]
    top_m = scale_top_m([size_m for _, size_m in shown if size_m is not None])
    camera = frame_camera([body for body, _ in shown], height_px=scene.panel_px)

    def picture(cell: Cell | None) -> NDArray[np.uint8]:
        if cell is None:
            return np.full((camera.height_px, camera.width_px, 3), 255, np.uint8)
        body, size_m = cell
        colours = None if size_m is None else magnitude_colours(size_m, top_m)
        return render_bodies([body], scene.body.faces, camera=camera, colours=[colours])

    pictures = [[picture(cell) for cell in row] for row in cells]
    draw_panels(path, pictures, origin=scene.origin, colour_top_m=top_m, **look)


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
