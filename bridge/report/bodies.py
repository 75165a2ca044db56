"""Figures 1, 2, 4, 7 and 9 of the paper, as rendered bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, pose_vertices
from bridge.body.posing import rest_vertices, shaped_vertices
from bridge.measure.pipelines import AUTOENCODER, MotionArrays, Pipeline, pipeline_of, pipelines_of
from bridge.motion import MotionSequence, unpack_theta
from bridge.report.panels import draw_panels, magnitude_colours, scale_top_m
from bridge.report.render import Camera, frame_camera, render_bodies
from bridge.runs import Artifact
from bridge.runs.artifact import DataOrigin

_ALONG = 7
"""Bodies of one motion in Figure 1."""
_OF_A_PERSON = 3
"""Bodies of one person in a row of Figure 9."""
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
        self, motions: MotionArrays, name: str, frames: NDArray, offsets_m: NDArray | None
    ) -> NDArray[np.float64]:
        """(N, V, 3) bodies of a motion and shape, without their travel along the floor."""
        pose, trans = unpack_theta(motions.frames("theta", name, frames))
        shapes = np.repeat(motions.betas(name)[None], len(frames), axis=0)
        return pose_vertices(self.body, shapes, pose, trans * [0.0, 1.0, 0.0], offsets_m)

    def picture(
        self, camera: Camera, body: NDArray, colours: NDArray | None = None
    ) -> NDArray[np.uint8]:
        """One body (V, 3), perhaps in colours (V, 3)."""
        return render_bodies([body], self.body.faces, camera=camera, colours=[colours])


def draw_figure1(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 1: a motion, and if possible a subject, that no network has seen, along the time; the
    bodies that skeleton and shape give, and what each pipeline makes of them."""
    frames = np.linspace(0, sequence.length - 1, _ALONG + 1).round().astype(int)[1:]
    name, first = sequence.name, scene.pipelines[0]
    shown: list[Column] = [("SMPL", scene.pose(first.motions, name, frames, None), None)]
    for pipeline in scene.pipelines:
        part_m = scene.offsets_m(pipeline.default, name, frames)
        moved = scene.pose(pipeline.motions, name, frames, part_m)
        label = pipeline.predictors[pipeline.default]
        shown.append((label, moved, np.linalg.norm(part_m, axis=-1)))
    title, times = f"Figure 1: skin offsets of an unseen motion, {name}", _times(sequence, frames)
    _draw_columns(path, scene, times, shown, title, "skin offset", 10.0, across=True)


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
    size_m = np.linalg.norm(offsets_m, axis=-1)
    columns: list[Column] = [
        ("(a) S", fitted, None),
        ("(b) W⁻¹(S)", unposed + rise_m, None),
        ("(c) M(β)", shaped + rise_m, None),
        ("(d) M(β, θ)", plain, None),
        ("(e) M(β, θ) + Δ", fitted, size_m),
    ]
    title = f"Figure 2: alignment of {name}"
    _draw_columns(path, scene, _times(sequence, frames), columns, title, "Δ", 10.0)


def draw_figure9(
    path: Path, scene: Scene, shown: Mapping[str, Sequence[MotionSequence | None]]
) -> None:
    """Figure 9: motions, observed ones first, by a known person and by a new one, who is framed.

    Parameters
    ----------
    shown : by title of a row, the known person's sequence and the new person's, where there is one.
    """
    pipeline = scene.pipelines[0]
    posed: list[NDArray] = []
    sizes_m: list[NDArray] = []
    for one in (one for pair in shown.values() for one in pair if one):
        frames = np.linspace(0, one.length - 1, _OF_A_PERSON + 2).round().astype(int)[1:-1]
        part_m = scene.offsets_m(pipeline.default, one.name, frames)
        posed.append(scene.pose(pipeline.motions, one.name, frames, part_m))
        sizes_m.append(np.linalg.norm(part_m, axis=-1))
    top_m = scale_top_m(np.concatenate(sizes_m))
    camera = frame_camera(list(np.concatenate(posed)), height_px=scene.panel_px)
    blank = np.full((camera.height_px, camera.width_px, 3), 255, np.uint8)
    drawn = iter(
        [
            scene.picture(camera, *one)
            for one in zip(bodies, magnitude_colours(size, top_m), strict=True)
        ]
        for bodies, size in zip(posed, sizes_m, strict=True)
    )
    rows = [
        [picture for one in pair for picture in (next(drawn) if one else [blank] * _OF_A_PERSON)]
        for pair in shown.values()
    ]
    framed = [
        (row, column)
        for row, (_, new) in enumerate(shown.values())
        for column in range(_OF_A_PERSON, 2 * _OF_A_PERSON)
        if new
    ]
    draw_panels(
        path,
        rows,
        title=f"Figure 9: {pipeline.predictors[pipeline.default]}, known and (framed) new people",
        origin=scene.origin,
        column_titles=["", "known", "", "", "new", ""],
        row_titles=list(shown),
        colour_top_m=top_m,
        colour_label="skin offset",
        width_in=9.0,
        framed=framed,
    )


def draw_figure4(path: Path, scene: Scene, sequence: MotionSequence) -> None:
    """Figure 4: aligned meshes, what the autoencoder makes of them, and its error."""
    frames, first, name = _lively_frames(scene, sequence, 2), scene.pipelines[0], sequence.name
    aligned_m = first.align.frames("offsets", name, frames)
    rebuilt_m = scene.offsets_m(AUTOENCODER, name, frames)
    original, rebuilt = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, rebuilt_m))
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
    truth, plain = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, None))
    letters = iter("cdef")
    columns: list[Column] = [("(a) ground truth", truth, None), ("(b) SMPL", plain, None)]
    for pipeline in scene.pipelines:
        part_m = scene.offsets_m(pipeline.default, name, frames)
        moved = scene.pose(pipeline.motions, name, frames, part_m)
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
    *,
    across: bool = False,
) -> None:
    """A picture for each time and column, on one scale of colour; times from left to right if
    `across`."""
    top_m = scale_top_m([sizes_m for *_, sizes_m in columns if sizes_m is not None])
    everything = np.concatenate([posed for _, posed, _ in columns])
    camera = frame_camera(list(everything), height_px=scene.panel_px)
    rows: list[list[NDArray[np.uint8]]] = []
    for row in range(len(times)):
        colours = [None if m is None else magnitude_colours(m[row], top_m) for *_, m in columns]
        bodies = [posed[row] for _, posed, _ in columns]
        rows.append([scene.picture(camera, *one) for one in zip(bodies, colours, strict=True)])
    titles = [column_title for column_title, *_ in columns]
    draw_panels(
        path,
        [*zip(*rows, strict=True)] if across else rows,
        title=title,
        origin=scene.origin,
        column_titles=times if across else titles,
        row_titles=titles if across else times,
        colour_top_m=top_m,
        colour_label=colour_label,
        width_in=width_in,
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
