"""The video that accompanies the paper (Section 6): Figures 7 and 9, moving."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bridge.errors import notify
from bridge.installation import how_to_install
from bridge.motion import MotionSequence, unpack_theta
from bridge.runs import ArtifactWriter
from bridge.runs.workers import progress, worker_pool
from dsnet.evaluation.pipelines import MotionArrays
from dsnet.exporters.clip_pictures import ClipPage, turned_to_camera
from dsnet.exporters.clips import encode_mp4
from dsnet.pictures.panels import FOOTERS, magnitude_colours, scale_top_m
from dsnet.pictures.render import Camera, frame_camera, render_bodies
from dsnet.pictures.skins import skin_of
from dsnet.report.bodies import Scene, Series, lively_frames

_STEP = 2
"""Every second frame is drawn: at the paper's 60 frames a second 30 pictures, in real time."""
_ASIDE_RAD, _GAP_M = 0.35, 0.12
_LEAST_COLUMN_PX = 160
"""Room for a title."""
_EXTRA = "clip"


class Figure(Protocol):
    """What is asked of a figure of the report."""

    @property
    def name(self) -> str: ...
    @property
    def arguments(self) -> Sequence[Any]: ...


def write_videos(writer: ArtifactWriter, figures: Iterable[Figure], pictures: int) -> list[str]:
    """Write `videos/<figure>.mp4` of those that move, with so many pictures at most; their names.

    None, and a line on stderr that says why, where the extra `clip` is not installed.
    """
    moving = [figure for figure in figures if figure.name in VIDEOS]
    if moving and not can_write():
        notify(f"left out: videos, which need imageio-ffmpeg. {how_to_install(_EXTRA)}")
        return []
    for one in progress(moving, what="videos", unit="video"):
        VIDEOS[one.name](writer.file_path(f"videos/{one.name}.mp4"), *one.arguments, pictures)
    return [one.name for one in moving]


def can_write() -> bool:
    """Whether there is an encoder."""
    return find_spec("imageio_ffmpeg") is not None


def write_figure7(path: Path, scene: Scene, sequence: MotionSequence, pictures: int) -> None:
    """The registered mesh, SMPL alone and each pipeline's prediction, of a held-out sequence.

    At most so many `pictures`, about the frame with the largest offsets.
    """
    name, first = sequence.name, scene.pipelines[0]
    (liveliest,) = lively_frames(scene, sequence, 1)
    frames = _frames_about(int(liveliest), sequence.length, pictures)
    aligned_m = first.align.frames("offsets", name, frames)
    truth, plain = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, None))
    columns: list[Series] = [
        ("registered mesh", truth, np.linalg.norm(aligned_m, axis=-1)),
        ("SMPL alone", plain, None),
    ]
    columns += [scene.predicted_series(one, name, frames) for one in scene.pipelines]
    _write(path, scene, [_turned(first.motions, name, one) for one in columns], sequence.fps)


def write_figure9(
    path: Path, scene: Scene, shown: Mapping[str, Sequence[MotionSequence | None]], pictures: int
) -> None:
    """The last of Figure 9's motions that a known and a new person do, or one of them alone."""
    pipeline = scene.pipelines[0]
    rows = [dict(zip(("known", "new"), pair, strict=True)) for pair in shown.values()]
    people = max(reversed(rows), key=lambda row: sum(one is not None for one in row.values()))
    columns: list[Series] = []
    present = {person: one for person, one in people.items() if one is not None}
    length = min(one.length for one in present.values())
    frames = _frames_about(length // 2, length, pictures)
    for person, one in present.items():
        label, posed, sizes_m = scene.predicted_series(pipeline, one.name, frames)
        series = f"{person}: {label}", posed, sizes_m
        columns.append(_turned(pipeline.motions, one.name, series))
    _write(path, scene, columns, next(iter(present.values())).fps)


def _frames_about(middle: int, length: int, pictures: int) -> NDArray[np.int64]:
    """Every second frame, at most so many, about a frame of a sequence as far as it goes."""
    drawn = np.arange(0, length, _STEP)
    first = int(np.clip(middle // _STEP - pictures // 2, 0, max(len(drawn) - pictures, 0)))
    return drawn[first : first + pictures]


def _turned(motions: MotionArrays, name: str, series: Series) -> Series:
    """The same bodies, facing the camera as the whole motion does in the mean."""
    title, posed, sizes_m = series
    pose, _ = unpack_theta(motions.frames("theta", name, slice(None)))
    turn = turned_to_camera(pose, _ASIDE_RAD)
    return title, turn.apply(posed.reshape(-1, 3)).reshape(posed.shape), sizes_m


def _write(path: Path, scene: Scene, columns: Sequence[Series], fps: float) -> None:
    row = _Row(scene, columns, fps / _STEP)
    path.parent.mkdir(parents=True, exist_ok=True)
    with worker_pool("threads", row) as pool:
        pages = pool.map(_Row.page, range(len(columns[0][1])))
        comment = f"{FOOTERS[scene.origin]}; " + ", ".join(title for title, *_ in columns)
        encode_mp4(path, pages, size_px=row.sheet.size_px, fps=row.fps, comment=comment)


VIDEOS = {"figure7_validation": write_figure7, "figure9_people": write_figure9}
"""By figure: takes a path, the arguments of the figure's own function, and a number of pictures."""


@dataclass(frozen=True, eq=False)
class _Row:
    """Bodies side by side on one floor, a column a series, in the pictures of a video."""

    scene: Scene
    columns: Sequence[Series]
    fps: float

    @cached_property
    def _low_high_m(self) -> NDArray[np.float64]:
        """(2, 3) the corners of a box around all bodies in one place."""
        every_m = np.concatenate([posed[:, ::5].reshape(-1, 3) for _, posed, _ in self.columns])
        return np.stack([every_m.min(axis=0), every_m.max(axis=0)])

    @cached_property
    def _column_m(self) -> float:
        width, height, _ = np.ptp(self._low_high_m, axis=0)
        return max(width + _GAP_M, height * _LEAST_COLUMN_PX / self.scene.panel_px)

    @cached_property
    def _camera(self) -> Camera:
        low, high = self._low_high_m
        spare = (self._column_m - (high[0] - low[0])) / 2
        last = (len(self.columns) - 1) * self._column_m
        sides = (low[0] - spare, high[0] + spare + last), (low[1], high[1]), (low[2], high[2])
        corners, height_px = [np.array(list(product(*sides)))], self.scene.panel_px // 2 * 2
        width_px = frame_camera(corners, height_px=height_px, azimuth_deg=0.0).width_px
        # H.264 wants even numbers.
        width_px += width_px % 2
        return frame_camera(corners, height_px=height_px, width_px=width_px, azimuth_deg=0.0)

    @cached_property
    def _top_m(self) -> float:
        sizes_m = [one[:, ::5].ravel() for *_, one in self.columns if one is not None]
        return scale_top_m(np.concatenate(sizes_m))

    @cached_property
    def sheet(self) -> ClipPage:
        titles = tuple(title for title, *_ in self.columns)
        size = self._camera.width_px, self._camera.height_px
        return ClipPage(*size, titles=titles, top_m=self._top_m, origin=self.scene.origin)

    def page(self, picture: int) -> Image.Image:
        """One picture with titles, scale, footer, and the time since the first."""
        step_m = np.array([self._column_m, 0.0, 0.0])
        bodies = [posed[picture] + k * step_m for k, (_, posed, _) in enumerate(self.columns)]
        colours = [
            skin_of(self.scene.body)
            if sizes_m is None
            else magnitude_colours(sizes_m[picture], self._top_m)
            for *_, sizes_m in self.columns
        ]
        faces = self.scene.body.faces
        drawn = render_bodies(bodies, faces, camera=self._camera, colours=colours)
        return self.sheet.with_picture(drawn, picture / self.fps)
