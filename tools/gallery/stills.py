"""One moment of several bodies as a picture, on one scale of colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bridge.motion import unpack_theta
from bridge.runs.artifact import DataOrigin
from dsnet.exporters.clip_pictures import turned_to_camera
from dsnet.pictures.panels import draw_panels, draw_row_of_bodies, magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.prediction.moving_body import MovingBody
from tools.gallery.performed import Performed

_ASIDE_RAD, _ABOVE_DEG = 0.6, 14.0
_WIDTH_IN = 7.5


@dataclass(frozen=True)
class Look:
    """How large and how fine pictures are."""

    width_px: int = 900
    """Of what is rendered for a still; a body that lies has 700/900 of it."""
    body_px: int = 260
    """Room for each body of a clip."""


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame of several bodies that move alike."""

    bodies: Sequence[Performed]
    frame: int
    of: MovingBody
    """One that moves as they do."""
    title: str

    @property
    def vertices_m(self) -> list[NDArray[np.floating]]:
        """(V, 3) of each body."""
        return [body.vertices_m[self.frame] for body in self.bodies]

    @property
    def sizes_m(self) -> list[NDArray[np.floating]]:
        """(V,) sizes of each body's offsets."""
        return [body.sizes_m[self.frame] for body in self.bodies]

    @property
    def labels(self) -> list[str]:
        """What each body is called."""
        return [body.label for body in self.bodies]

    @property
    def faces(self) -> NDArray:
        """Of every body."""
        return self.of.body.faces

    @property
    def origin(self) -> DataOrigin:
        """Of the data that the predictor was trained on."""
        return self.of.trained.origin

    @property
    def pose(self) -> NDArray:
        """(1, 22, 3) axis-angle, radians."""
        return unpack_theta(self.of.motion.theta[self.frame : self.frame + 1])[0]


def draw_upright(path: Path, moment: Moment, look: Look) -> None:
    """Write a PNG of the bodies side by side, a little from the side."""
    turn = turned_to_camera(moment.pose, _ASIDE_RAD)
    draw_row_of_bodies(
        path,
        [turn.apply(body_m) for body_m in moment.vertices_m],
        moment.sizes_m,
        moment.faces,
        labels=moment.labels,
        origin=moment.origin,
        title=moment.title,
        width_px=look.width_px,
        width_in=_WIDTH_IN,
    )


def draw_lying(path: Path, moment: Moment, look: Look) -> None:
    """The same of bodies that lie: their heads to the left, one below the other."""
    # As if the head were the front.
    root = Rotation.from_rotvec(moment.pose[:, 0]) * Rotation.from_euler("x", -np.pi / 2)
    turn = turned_to_camera(root.as_rotvec()[:, None], -np.pi / 2)
    placed_m = [_at_home(body_m, turn) for body_m in moment.vertices_m]
    width_px = look.width_px * 7 // 9
    camera = frame_camera(
        placed_m,
        height_px=width_px // 3,
        width_px=width_px,
        azimuth_deg=0.0,
        elevation_deg=_ABOVE_DEG,
    )
    top_m = scale_top_m(np.concatenate(moment.sizes_m))
    pictures = [
        render_bodies(
            [body_m],
            moment.faces,
            camera=camera,
            colours=[magnitude_colours(size_m, top_m)],
        )
        for body_m, size_m in zip(placed_m, moment.sizes_m, strict=True)
    ]
    draw_panels(
        path,
        [[picture] for picture in pictures],
        title=moment.title,
        origin=moment.origin,
        column_titles=[""],
        row_titles=moment.labels,
        colour_top_m=top_m,
        colour_label="skin offset",
        width_in=_WIDTH_IN,
    )


def _at_home(vertices_m: NDArray, turn: Rotation) -> NDArray[np.float64]:
    """(V, 3) turned, above the middle of the floor; its height stays."""
    turned_m = turn.apply(vertices_m)
    low_m, high_m = turned_m.min(axis=0), turned_m.max(axis=0)
    return turned_m - (low_m + high_m) / 2 * [1.0, 0.0, 1.0]
