"""A motion as pictures: SMPL alone, and beside it each predicted skin, its offsets as colours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bridge.body.posing import Smpl
from bridge.export.clip_page import ClipPage
from bridge.export.clip_stage import set_stage
from bridge.motion import unpack_theta
from bridge.report.panels import magnitude_colours
from bridge.report.render import render_bodies
from bridge.runs.progress import progress
from bridge.runs.worker_pool import worker_pool
from bridge.runtime.moving_body import MovingBody


class RenderedClip:
    """Pages of a clip, in order when iterated; predicts the motion twice.

    Parameters
    ----------
    moving : the same body in the same motion, moved by one predictor or several.
    fps : pictures a second; those frames are drawn that come nearest below the motion's rate.
    body_px : room for each body, from left to right; an even number.
    recorded : whose motion it is, if it was recorded.
    """

    def __init__(
        self, moving: Sequence[MovingBody], *, fps: float, body_px: int, recorded: str = ""
    ) -> None:
        self._moving, self._body = moving, moving[0].body
        self._motion = motion = moving[0].motion
        self._step = max(1, round(motion.fps / fps))
        self._stage = set_stage(moving, self._step, body_px * (1 + len(moving)))
        self._alone = Smpl(self._body).person(motion.betas)
        camera = self._stage.camera
        self._page = ClipPage(
            camera.width_px,
            camera.height_px,
            titles=("SMPL alone", *(one.trained.label for one in moving)),
            top_m=self._stage.top_m,
            origin=moving[0].trained.origin,
            recorded=recorded,
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of a page."""
        return self._page.size_px

    @property
    def fps(self) -> float:
        """Pictures a second."""
        return self._motion.fps / self._step

    def __iter__(self) -> Iterator[Image.Image]:
        frames = range(0, len(self._motion.theta), self._step)
        bodies = zip(*map(self._painted, self._moving), strict=True)
        with (
            worker_pool("threads", self) as pool,
            progress(what="pictures", unit="picture", total=len(frames)) as bar,
        ):
            for page in pool.map(RenderedClip._draw, zip(frames, bodies, strict=True)):
                bar.update()
                yield page

    def _painted(self, moving: MovingBody) -> Iterator[tuple[NDArray, NDArray]]:
        """Vertices and colours (V, 3) of each frame that is drawn."""
        for posed in moving:
            for row in range(-posed.frames.start % self._step, len(posed), self._step):
                sizes_m = np.linalg.norm(posed.offsets_m[row], axis=1)
                yield posed.vertices_m[row], magnitude_colours(sizes_m, self._stage.top_m)

    def with_all_colours(self) -> Image.Image:
        """The first page as if offsets of every size lay upon the body: what a palette is for."""
        first_m = self._pose_alone(0)
        height = np.ptp(first_m[:, 1])
        ramp = (first_m[:, 1] - first_m[:, 1].min()) / height
        return self._draw((0, [(first_m, magnitude_colours(ramp, 1.0))] * len(self._moving)))

    def _draw(self, item: tuple[int, Sequence[tuple[NDArray, NDArray]]]) -> Image.Image:
        """The page of a frame, for which each predictor gives vertices and colours (V, 3)."""
        frame, predicted = item
        bodies = [(self._pose_alone(frame), None), *predicted]
        picture = render_bodies(
            [
                self._stage.place(shape_m, frame, column)
                for column, (shape_m, _) in enumerate(bodies)
            ],
            self._body.faces,
            camera=self._stage.camera,
            colours=[paint for _, paint in bodies],
        )
        return self._page.with_picture(picture, frame / self._motion.fps)

    def _pose_alone(self, frame: int) -> NDArray[np.float32]:
        """(V, 3) the body without offsets."""
        pose, trans_m = unpack_theta(self._motion.theta[frame : frame + 1])
        return self._alone.pose(pose, trans_m)[0]
