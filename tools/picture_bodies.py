"""One motion by the packaged flesh, on its own body and on another: docs/images/other_body.png.

python -m tools.picture_bodies BODY   # a model file of the woman that is to be beside
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from dsnet.pictures.panels import draw_panels, magnitude_colours
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.prediction.controls import Controls, controlled_body

OUT = Path("docs/images/other_body.png")
FRAMES = (30, 68, 102, 150, 205)
TOP_M = 0.05


def main(other: str) -> None:
    """Draw both in a few frames."""
    camera, pictures, titles = None, [], []
    for body in (None, Path(other)):
        asked = Controls(body=body, floor="shift")
        moving = controlled_body(*asked.load(None, None, Path("sample:jumping_jacks")), asked)
        parts = [(part.vertices_m, part.offsets_m) for part in moving]
        vertices_m, offsets_m = (np.concatenate(both) for both in zip(*parts, strict=True))
        posed = np.array(vertices_m[[*FRAMES]], np.float64)
        posed[..., [0, 2]] -= posed[..., [0, 2]].mean(axis=1, keepdims=True)
        colours = magnitude_colours(np.linalg.norm(offsets_m[[*FRAMES]], axis=-1), TOP_M)
        camera = camera or frame_camera(list(posed), height_px=420, azimuth_deg=20.0)
        pictures.append([
            render_bodies([one], moving.body.faces, camera=camera, colours=[colour])
            for one, colour in zip(posed, colours, strict=True)
        ])  # fmt: skip
        titles.append(f"{moving.body.kind}, {moving.body.vertex_count} vertices")
    draw_panels(
        OUT,
        pictures,
        title="One motion, two bodies",
        origin="synthetic",
        column_titles=[f"{frame / 60:.2f} s" for frame in FRAMES],
        row_titles=titles,
        colour_top_m=TOP_M,
        colour_label="skin offset",
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
