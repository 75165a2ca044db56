"""A moving body as pictures: SMPL alone, and beside it the skin with its offsets as colours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bridge.export.clip_page import BAR_PX, ClipPage
from bridge.export.clip_render import PaintedBody, render_clip_picture
from bridge.export.clip_stage import set_stage
from bridge.export.surface_frames import VertexNormals
from bridge.motion import unpack_theta
from bridge.report.panels import magnitude_colours
from bridge.report.render import CLAY_SRGB
from bridge.runtime.moving_body import MovingBody
from bridge.runtime.skinning import ShapedBody


class RenderedClip:
    """Pages of a clip, in order when iterated; predicts the motion twice.

    Parameters
    ----------
    fps : pictures a second; those frames are drawn that come nearest below the motion's rate.
    width_px : of a page.
    """

    def __init__(self, moving: MovingBody, *, fps: float, width_px: int) -> None:
        self._moving, body = moving, moving.character.body
        self._step = max(1, round(moving.motion.fps / fps))
        self._stage = set_stage(moving, self._step, width_px - BAR_PX)
        self._alone = ShapedBody(body, moving.motion.betas)
        self._normals = VertexNormals(body.faces, body.vertex_count)
        chosen, camera = moving.character.chosen, self._stage.camera
        self._page = ClipPage(
            camera.width_px,
            camera.height_px,
            titles=("SMPL alone", chosen.label),
            top_m=self._stage.top_m,
            origin=chosen.trained.origin,
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of a page."""
        return self._page.size_px

    @property
    def fps(self) -> float:
        """Pictures a second."""
        return self._moving.motion.fps / self._step

    def __iter__(self) -> Iterator[Image.Image]:
        for posed in self._moving:
            for row in range(-posed.frames.start % self._step, len(posed), self._step):
                frame, sizes_m = posed.frames.start + row, posed.offsets_m[row]
                colours = magnitude_colours(np.linalg.norm(sizes_m, axis=1), self._stage.top_m)
                yield self._draw(frame, posed.vertices_m[row], colours)

    def with_all_colours(self) -> Image.Image:
        """The first page as if offsets of every size lay upon the body: what a palette is for."""
        first_m = self._pose_alone(0)
        height = np.ptp(first_m[:, 1])
        ramp = (first_m[:, 1] - first_m[:, 1].min()) / height
        return self._draw(0, first_m, magnitude_colours(ramp, 1.0))

    def _draw(self, frame: int, vertices_m: NDArray, colours: NDArray) -> Image.Image:
        alone_m = self._pose_alone(frame)
        clay = np.broadcast_to(CLAY_SRGB, alone_m.shape)
        bodies = []
        for column, (shape_m, paint) in enumerate([(alone_m, clay), (vertices_m, colours)]):
            placed = self._stage.place(shape_m, frame, column)
            bodies.append(PaintedBody(placed, self._normals(placed), paint))
        faces = self._moving.character.body.faces
        picture = render_clip_picture(bodies, faces, self._stage.camera)
        return self._page.with_picture(picture, frame / self._moving.motion.fps)

    def _pose_alone(self, frame: int) -> NDArray[np.float32]:
        """(V, 3) the body without offsets."""
        pose, trans_m = unpack_theta(self._moving.motion.theta[frame : frame + 1])
        return self._alone.pose(pose, trans_m, np.zeros((1, 1, 3), np.float32))[0]
