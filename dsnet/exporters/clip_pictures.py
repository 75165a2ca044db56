"""A motion as pictures: SMPL alone, and beside it each predicted skin, its offsets as colours.

The bodies are turned so that they mostly face the camera, a little to the side. The smoothed path
along the floor is removed; height above the floor stays. Each picture has titles, the scale of the
colours in cm and a line that names the data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, product

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from bridge.body.posing import Smpl
from bridge.motion import unpack_theta
from bridge.runs.artifact import DataShown
from bridge.runs.workers import progress, worker_pool
from dsnet.pictures.panels import MAGNITUDE_COLOURS, footer, magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.pictures.skins import skin_of
from dsnet.prediction.moving_body import MovingBody

_SMOOTH_S, _CAMERA_ANGLE_RAD, _GAP_M = 0.5, 0.35, 0.15
_EVERY_VERTEX = 10
_FRAMES_MEASURED = 300
"""Most frames by which the colours are scaled."""
_TITLE_PX, _FOOT_PX, _BAR_PX, _DPI = 30, 22, 62, 100
_POINTS_A_PX = 72 / _DPI


class RenderedClip:
    """An iterable of a clip's pages, in order; the motion is predicted twice.

    Parameters
    ----------
    moving : the same body and motion by one or several predictors.
    fps : wanted pictures a second; every n-th frame is drawn, so that the rate comes near.
    body_px : width for each body, an even number.
    recorded : source of the motion, if it was recorded.
    """

    def __init__(
        self, moving: Sequence[MovingBody], *, fps: float, body_px: int, recorded: str = ""
    ) -> None:
        self._moving, self._body = moving, moving[0].body
        self._motion = motion = moving[0].motion
        self._step = max(1, round(motion.fps / fps))
        self.fps = motion.fps / self._step
        self._stage = ClipStage(moving, self._step, body_px * (1 + len(moving)))
        self._alone = Smpl(self._body).person(motion.betas)
        self._skin = None if moving[0].plain else skin_of(self._body)
        camera, titles = self._stage.camera, [one.trained.label for one in moving]
        self._page = ClipPage(
            camera.width_px,
            camera.height_px,
            titles=("SMPL alone", *titles),
            top_m=self._stage.top_m,
            origin=moving[0].trained.shows,
            recorded=recorded,
        )
        self.size_px = self._page.size_px
        """Width and height of a page."""

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
        """The first page with all colours of the scale on the bodies, to make a palette of."""
        first_m = self._pose_alone(0)
        ramp = (first_m[:, 1] - first_m[:, 1].min()) / np.ptp(first_m[:, 1])
        return self._draw((0, [(first_m, magnitude_colours(ramp, 1.0))] * len(self._moving)))

    def _draw(self, item: tuple[int, Sequence[tuple[NDArray, NDArray]]]) -> Image.Image:
        """The page of one frame: its number, and vertices and colours (V, 3) of each predictor."""
        frame, predicted = item
        bodies = [(self._pose_alone(frame), self._skin), *predicted]
        picture = render_bodies(
            [self._stage.place(body[0], frame, column) for column, body in enumerate(bodies)],
            self._body.faces,
            camera=self._stage.camera,
            colours=[paint for _, paint in bodies],
        )
        return self._page.with_picture(picture, frame / self._motion.fps)

    def _pose_alone(self, frame: int) -> NDArray[np.float32]:
        """(V, 3) the body without offsets."""
        one = slice(frame, frame + 1)
        return self._alone.pose(self._moving[0].pose[one], self._motion.trans_m[one])[0]


class ClipStage:
    """Positions of the bodies, camera and colour scale, which all pictures of a clip share.

    Predicts the motion once and fits the `camera`, `width_px` wide, to every `step`-th frame. Skin
    offsets of the size `top_m` get the darkest colour.

    Parameters
    ----------
    moving : the same motion by each predictor; the first column is for SMPL alone.
    """

    def __init__(self, moving: Sequence[MovingBody], step: int, width_px: int) -> None:
        motion = moving[0].motion
        pose, trans_m = unpack_theta(motion.theta)
        path_m = gaussian_filter1d(trans_m, _SMOOTH_S * motion.fps, axis=0, mode="nearest")
        self._path_m = path_m * [1.0, 0.0, 1.0]
        self._turn, self._column_m = turned_to_camera(pose, _CAMERA_ANGLE_RAD), 0.0
        every_drawn = -(-len(motion.theta) // (step * _FRAMES_MEASURED))
        low, high, sizes_m = np.full(3, np.inf), np.full(3, -np.inf), []
        for posed in chain.from_iterable(one.shown("measure") for one in moving):
            for row in range(-posed.frames.start % step, len(posed), step):
                frame = posed.frames.start + row
                drawn = self.place(posed.vertices_m[row, ::_EVERY_VERTEX], frame, 0)
                low, high = np.minimum(low, drawn.min(axis=0)), np.maximum(high, drawn.max(axis=0))
                if frame // step % every_drawn == 0:
                    offsets_m = posed.offsets_m[row, ::_EVERY_VERTEX]
                    sizes_m.append(np.linalg.norm(offsets_m, axis=1))
        self._column_m = high[0] - low[0] + _GAP_M
        high[0] += self._column_m * len(moving)
        corners = np.array(list(product(*zip(low, high, strict=True))))
        size = np.ptp(corners, axis=0)
        height_px = width_px * (size[1] + 0.15 * size[2]) / size[0]
        height_px = int(np.clip(height_px, 0.4 * width_px, 1.2 * width_px)) // 2 * 2
        self.camera = frame_camera(
            [corners], height_px=height_px, width_px=width_px, azimuth_deg=0.0
        )
        self.top_m = scale_top_m(np.concatenate(sizes_m))

    def place(self, vertices_m: NDArray, frame: int, column: int) -> NDArray[np.float64]:
        """Vertices (V, 3) of one frame as they are drawn in a column, which is counted from 0."""
        placed = self._turn.apply(vertices_m - self._path_m[frame])
        placed[:, 0] += column * self._column_m
        return placed


def turned_to_camera(pose: NDArray, angle_rad: float) -> Rotation:
    """The rotation about y after which bodies of pose (T, 22, 3) face a camera that looks along -z.

    They are turned aside by `angle_rad`.
    """
    ahead = Rotation.from_rotvec(pose[:, 0]).apply([0.0, 0.0, 1.0]).mean(axis=0)
    return Rotation.from_euler("y", angle_rad - np.arctan2(ahead[0], ahead[2]))


class ClipPage:
    """A page with room for one picture of a row of bodies.

    Parameters
    ----------
    width_px, height_px : of the picture, even numbers.
    titles : of the bodies, from left to right.
    top_m : offset of the darkest colour.
    recorded : source of the motion, if it was recorded.
    """

    def __init__(
        self,
        width_px: int,
        height_px: int,
        *,
        titles: tuple[str, ...],
        top_m: float,
        origin: DataShown,
        recorded: str = "",
    ) -> None:
        self._time_place = 6, _TITLE_PX + height_px - 16
        self._font = ImageFont.load_default(12)
        self.size_px = page_px = width_px + _BAR_PX, height_px + _TITLE_PX + _FOOT_PX
        # Half a pixel more, as Matplotlib rounds down: 4.14 * 100 is less than 414.
        width_in, height_in = ((side_px + 0.5) / _DPI for side_px in page_px)
        figure = Figure(figsize=(width_in, height_in), dpi=_DPI)

        def place(x_px: float, y_px: float) -> tuple[float, float]:
            """Pixels from left and top as shares of the page from left and bottom."""
            return x_px / page_px[0], 1 - y_px / page_px[1]

        column_px = width_px / len(titles)
        # The longest label of a predictor fills four fifths of its column.
        points = min(max(column_px / 16, 10), 18) * _POINTS_A_PX
        for column, title in enumerate(titles):
            at = place((column + 0.5) * column_px, 8)
            figure.text(*at, title, fontsize=points, ha="center", va="top")
        at = place(page_px[0] / 2, _TITLE_PX + height_px + 5)
        foot = figure.text(
            *at, footer(origin, recorded), fontsize=11 * _POINTS_A_PX, ha="center", va="top"
        )
        foot.set(color="#8a4b00", style="italic")
        left, bottom = place(width_px + 6, _TITLE_PX + 0.85 * height_px)
        axes = figure.add_axes((left, bottom, 10 / page_px[0], 0.7 * height_px / page_px[1]))
        scale = ScalarMappable(Normalize(0.0, 100 * top_m), MAGNITUDE_COLOURS)
        bar = figure.colorbar(scale, cax=axes, extend="max")
        bar.set_label("skin offset [cm]", fontsize=11 * _POINTS_A_PX)
        bar.ax.tick_params(labelsize=10 * _POINTS_A_PX)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        self._blank = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    def with_picture(self, picture: NDArray[np.uint8], time_s: float) -> Image.Image:
        """The page with a picture (height, width, 3) on it, and its time."""
        page = self._blank.copy()
        page.paste(Image.fromarray(picture), (0, _TITLE_PX))
        draw = ImageDraw.Draw(page)
        draw.text(self._time_place, f"{time_s:.2f} s", fill=(90, 90, 90), font=self._font)
        return page
