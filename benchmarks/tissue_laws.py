"""`python -m benchmarks.tissue_laws --out DIR`: the same motions under every tissue law.

Measures how far flesh moves and how much of the other laws' offsets the own one's explain, and
draws one jump under each.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import plugin
from benchmarks.processes import run_as_process
from bridge.body import BodyModelData, load_body_model
from bridge.paper import FPS
from bridge.runs.files import write_text_atomically
from dsnet.pictures.panels import draw_panels, magnitude_colours, scale_top_m
from dsnet.pictures.render import frame_camera, render_bodies
from dsnet.synthetic.motions import Skeleton, perform
from dsnet.synthetic.simulation import TissueSimulator, posed_meshes
from dsnet.synthetic.subjects import SUBJECTS, Subject

_OWN = "own"
_MOTIONS = ("one_leg_jump", "kicking", "hips", "shake_arms")
_PANELS = 4


@dataclass(frozen=True)
class TissueLawsConfig:
    """Compare the laws on the heaviest and the leanest woman."""

    out: Path
    """Folder that receives tissue_laws.json and tissue_laws.png."""
    frames: int = 120
    """Length of each motion at 60 fps."""


def main(config: TissueLawsConfig) -> dict[str, Any]:
    """Write the results; also returns them."""
    woman = load_body_model("embedded:female")
    laws, rows, pictured = {_OWN: TissueSimulator, **plugin.tissues()}, [], {}
    for motion in _MOTIONS:
        for subject in (SUBJECTS["female"][0], SUBJECTS["female"][-1]):
            theta = perform(
                motion,
                subject.name,
                Skeleton(woman, subject.betas),
                frame_count=config.frames,
                fps=FPS,
            )
            offsets = {
                name: law(woman, subject.betas, gravity=True).offsets(theta, FPS)
                for name, law in laws.items()
            }
            rows.append({"motion": motion, "subject": subject.name, "laws": compared(offsets)})
            pictured = pictured or {"subject": subject, "theta": theta, "offsets": offsets}
    command = " ".join(["python", "-m", "benchmarks.tissue_laws", *sys.argv[1:]])
    results = {"data": "synthetic", "rows": rows, "frames": config.frames, "command": command}
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / "tissue_laws.json", text)
    draw(config.out / "tissue_laws.png", woman, **pictured)
    return results


def draw(
    path: Path,
    woman: BodyModelData,
    subject: Subject,
    theta: NDArray[np.floating],
    offsets: dict[str, NDArray[np.float32]],
) -> None:
    """The liveliest frames of equal parts of a motion, a row for each law."""
    lively = np.square(offsets[_OWN]).sum((1, 2))
    parts = np.array_split(np.arange(len(theta)), _PANELS)
    frames = [part[lively[part].argmax()] for part in parts]
    sizes = {name: np.linalg.norm(own[frames], axis=-1) for name, own in offsets.items()}
    top_m = scale_top_m(np.stack(list(sizes.values())))
    bodies = {
        name: posed_meshes(woman, subject.betas, theta[frames], own[frames])
        for name, own in offsets.items()
    }
    camera = frame_camera([body for row in bodies.values() for body in row], height_px=420)
    pictures = [
        [
            render_bodies(
                [body], woman.faces, camera=camera, colours=[magnitude_colours(size, top_m)]
            )
            for body, size in zip(bodies[name], sizes[name], strict=True)
        ]
        for name in offsets
    ]
    draw_panels(
        path,
        pictures,
        title=f"One jump of {subject.name} under every tissue law",
        origin="synthetic",
        column_titles=[f"{frame / FPS:.2f} s" for frame in frames],
        row_titles=list(offsets),
        colour_top_m=top_m,
        colour_label="offset",
    )


def compared(offsets: Mapping[str, NDArray[np.float32]]) -> dict[str, dict[str, float]]:
    """Sizes under each law, and the share of the others that no multiple of the own explains."""
    own = offsets[_OWN].astype(np.float64)
    found = {}
    for name, of_law in offsets.items():
        lengths = np.linalg.norm(of_law, axis=-1) * 1000
        found[name] = {"mean_mm": float(lengths.mean()), "max_mm": float(lengths.max())}
        if name != _OWN:
            scale = (own * of_law).sum() / (own**2).sum()
            unlike = ((of_law - scale * own) ** 2).sum() / np.square(of_law, dtype=np.float64).sum()
            found[name]["unlike"] = float(unlike)
    return found


if __name__ == "__main__":
    run_as_process(TissueLawsConfig, main)
