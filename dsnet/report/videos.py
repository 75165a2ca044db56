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
_HELD_OUT, _HELD_OUT_CLIP = "figure7_validation", "figures/held_out.webp"
_WEBP_PX, _WEBP_QUALITY = 900, 70
"""Most width of the clip at the head of the page, which is inside the page."""


class Figure(Protocol):
    """What is asked of a figure of the report."""

    @property
    def name(self) -> str: ...
    @property
    def arguments(self) -> Sequence[Any]: ...


def write_videos(writer: ArtifactWriter, figures: Iterable[Figure], pictures: int) -> list[str]:
    """Write those of the figures that move, with so many pictures at most.

    Figure 7 is an animated picture, `figures/held_out.webp`. Where the extra `clip` is installed,
    all are `videos/<figure>.mp4` too, and their names are given; otherwise a line on stderr says
    why not.
    """
    moving, encoded = [figure for figure in figures if figure.name in _ROWS], can_encode()
    if moving and not encoded:
        notify(f"left out: videos, which need imageio-ffmpeg. {how_to_install(_EXTRA)}")
        moving = [figure for figure in moving if figure.name == _HELD_OUT]
    for figure in progress(moving, what="videos", unit="video"):
        row = _ROWS[figure.name](*figure.arguments, pictures)
        pages = row.pages()
        if figure.name == _HELD_OUT:
            write_webp(writer.file_path(_HELD_OUT_CLIP), pages, row.fps)
        if encoded:
            path = writer.file_path(f"videos/{figure.name}.mp4")
            size_px, about = row.sheet.size_px, row.about
            encode_mp4(path, pages, size_px=size_px, fps=row.fps, comment=about)
    return [figure.name for figure in moving if encoded]


def can_encode() -> bool:
    """Whether there is an encoder of MP4."""
    return find_spec("imageio_ffmpeg") is not None


def write_webp(path: Path, pages: Sequence[Image.Image], fps: float) -> None:
    """Write pages as an animated picture that loops, at most 900 pixels wide."""
    width, height = pages[0].size
    scale = min(1.0, _WEBP_PX / width)
    size = round(width * scale), round(height * scale)
    first, *others = [page.resize(size, Image.Resampling.LANCZOS) for page in pages]
    first.save(
        path,
        save_all=True,
        append_images=others,
        quality=_WEBP_QUALITY,
        duration=round(1000 / fps),
        loop=0,
    )


def _figure7(scene: Scene, sequence: MotionSequence, pictures: int) -> _Row:
    """SMPL alone, each pipeline's prediction and the registered mesh, of a held-out sequence.

    At most so many `pictures`, about the frame with the largest offsets.
    """
    name, first = sequence.name, scene.pipelines[0]
    (liveliest,) = lively_frames(scene, sequence, 1)
    frames = _frames_about(int(liveliest), sequence.length, pictures)
    aligned_m = first.align.frames("offsets", name, frames)
    truth, plain = (scene.pose(first.motions, name, frames, o) for o in (aligned_m, None))
    columns: list[Series] = [
        ("SMPL alone", plain, None),
        *(scene.predicted_series(one, name, frames) for one in scene.pipelines),
        ("ground truth", truth, np.linalg.norm(aligned_m, axis=-1)),
    ]
    turned = [_turned(first.motions, name, one) for one in columns]
    return _Row(scene, turned, sequence.fps / _STEP)


def _figure9(
    scene: Scene, shown: Mapping[str, Sequence[MotionSequence | None]], pictures: int
) -> _Row:
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
    return _Row(scene, columns, next(iter(present.values())).fps / _STEP)


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

    @property
    def about(self) -> str:
        """The kind of data, and the titles."""
        return f"{FOOTERS[self.scene.origin]}; " + ", ".join(title for title, *_ in self.columns)

    def pages(self) -> list[Image.Image]:
        """All pictures, in order."""
        with worker_pool("threads", self) as pool:
            return [*pool.map(_Row._page, range(len(self.columns[0][1])))]

    def _page(self, picture: int) -> Image.Image:
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


_ROWS = {_HELD_OUT: _figure7, "figure9_people": _figure9}
"""By figure: takes the arguments of the figure's own function, and a number of pictures."""
