"""What stands around a clip's pictures: titles, the colours' scale in cm, whose data it is."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from bridge.report.panels import MAGNITUDE_COLOURS, footer
from bridge.runs.artifact import DataOrigin

BAR_PX = 62
_TITLE_PX, _FOOT_PX, _DPI = 30, 22, 100
_POINTS_A_PX = 72 / _DPI


class ClipPage:
    """A page with room for one picture of a row of bodies.

    Parameters
    ----------
    width_px, height_px : of the picture, even numbers.
    titles : of the bodies, from left to right.
    top_m : what the darkest colour means.
    recorded : whose motion it is, if it was recorded.
    """

    def __init__(
        self,
        width_px: int,
        height_px: int,
        *,
        titles: tuple[str, ...],
        top_m: float,
        origin: DataOrigin,
        recorded: str = "",
    ) -> None:
        self._picture_px = width_px, height_px
        self.size_px = width_px + BAR_PX, height_px + _TITLE_PX + _FOOT_PX
        self._font = ImageFont.load_default(12)
        # Matplotlib cuts off what is less than a pixel, as 4.14 * 100 is less than 414.
        width_in, height_in = ((side_px + 0.5) / _DPI for side_px in self.size_px)
        figure = Figure(figsize=(width_in, height_in), dpi=_DPI)
        column_px = width_px / len(titles)
        for column, title in enumerate(titles):
            # The longest label of a predictor fills four fifths of its column.
            title_px = min(max(column_px / 16, 10), 18)
            self._write(figure, (column + 0.5) * column_px, 8, title, title_px)
        below_px = _TITLE_PX + height_px + 5
        text = footer(origin, recorded)
        foot = self._write(figure, self.size_px[0] / 2, below_px, text, 11)
        foot.set(color="#8a4b00", style="italic")
        self._draw_bar(figure, top_m)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        self._blank = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    def with_picture(self, picture: NDArray[np.uint8], time_s: float) -> Image.Image:
        """The page with a picture (height, width, 3) on it, and its time."""
        page = self._blank.copy()
        page.paste(Image.fromarray(picture), (0, _TITLE_PX))
        place = (6, _TITLE_PX + self._picture_px[1] - 16)
        ImageDraw.Draw(page).text(place, f"{time_s:.2f} s", fill=(90, 90, 90), font=self._font)
        return page

    def _place(self, x_px: float, y_px: float) -> tuple[float, float]:
        """A place from the left and the top as parts of the page, from the bottom."""
        return x_px / self.size_px[0], 1 - y_px / self.size_px[1]

    def _write(
        self, figure: Figure, middle_px: float, top_px: float, text: str, size_px: float
    ) -> Text:
        x, y = self._place(middle_px, top_px)
        return figure.text(x, y, text, fontsize=size_px * _POINTS_A_PX, ha="center", va="top")

    def _draw_bar(self, figure: Figure, top_m: float) -> None:
        width_px, height_px = self._picture_px
        left, bottom = self._place(width_px + 6, _TITLE_PX + 0.85 * height_px)
        size = 10 / self.size_px[0], 0.7 * height_px / self.size_px[1]
        scale = ScalarMappable(Normalize(0.0, 100 * top_m), MAGNITUDE_COLOURS)
        bar = figure.colorbar(scale, cax=figure.add_axes((left, bottom, *size)), extend="max")
        bar.set_label("skin offset [cm]", fontsize=11 * _POINTS_A_PX)
        bar.ax.tick_params(labelsize=10 * _POINTS_A_PX)
