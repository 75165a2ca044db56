"""`python -m benchmarks.tissue_laws --out DIR`: the same motions under both tissue laws.

Tabulates how far flesh moves and how much of the second law's offsets the first's explain, and
draws one jump under both.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body import load_body_model
from bridge.report.panels import draw_panels, magnitude_colours, scale_top_m
from bridge.report.render import frame_camera, render_bodies
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process
from torch_align_ae.body import SMPL
from torch_align_ae.corpus.motions import Skeleton, perform
from torch_align_ae.corpus.simulation import body_in_double, posed_meshes
from torch_align_ae.corpus.subjects import SUBJECTS, Subject
from torch_align_ae.corpus.tissue_laws import TISSUES, tissue_of

_FPS = 60.0
_MOTIONS = ("one_leg_jump", "kicking", "hips", "shake_arms")
_PANELS = 4
_PAGE = """\
# The same motions under both tissue laws (synthetic data)

| motion | subject | mean, max of `own` | mean, max of `second` | unlike |
|---|---|---:|---:|---:|
{rows}

Offsets in millimetres; with gravity, {frames} frames at 60 fps. *Unlike* is the share of the second
law's squared offsets that no multiple of the own law's explains. Made by `{command}`.
"""


@dataclass(frozen=True)
class TissueLawsConfig:
    """Compare the laws on the heaviest and the leanest woman."""

    out: Path
    """Folder that receives tissue_laws.json, tissue_laws.md and tissue_laws.png."""
    frames: int = 120
    """Length of each motion at 60 fps."""


def main(config: TissueLawsConfig) -> dict[str, Any]:
    """Write the results; also returns them."""
    smpl = body_in_double(load_body_model("embedded:female"))
    rows, pictured = [], {}
    for motion in _MOTIONS:
        for subject in (SUBJECTS["female"][0], SUBJECTS["female"][-1]):
            theta = perform(
                motion,
                subject.name,
                Skeleton.of(smpl.data, subject.betas),
                frame_count=config.frames,
                fps=_FPS,
            )
            offsets = {
                name: tissue_of(name, smpl, subject.betas).offsets(theta, _FPS) for name in TISSUES
            }
            rows.append({"motion": motion, "subject": subject.name, **compared(offsets)})
            pictured = pictured or {"subject": subject, "theta": theta, "offsets": offsets}
    command = " ".join(["python", "-m", "benchmarks.tissue_laws", *sys.argv[1:]])
    results = {"data": "synthetic", "rows": rows, "frames": config.frames, "command": command}
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1, allow_nan=False) + "\n"
    write_text_atomically(config.out / "tissue_laws.json", text)
    write_text_atomically(config.out / "tissue_laws.md", markdown(results))
    draw(config.out / "tissue_laws.png", smpl, **pictured)
    return results


def markdown(results: dict[str, Any]) -> str:
    """A page with one table: a row for each motion and subject."""
    rows = [
        f"| `{row['motion']}` | {row['subject']} |"
        f" {row['own']['mean_mm']:.2f}, {row['own']['max_mm']:.1f} |"
        f" {row['second']['mean_mm']:.2f}, {row['second']['max_mm']:.1f} |"
        f" {row['unlike']:.2f} |"
        for row in results["rows"]
    ]
    return _PAGE.format(**{**results, "rows": "\n".join(rows)})


def draw(
    path: Path,
    smpl: SMPL,
    subject: Subject,
    theta: NDArray[np.floating],
    offsets: dict[str, NDArray[np.float32]],
) -> None:
    """The liveliest frames of equal parts of a motion, a row for each law."""
    lively = np.square(offsets["own"]).sum((1, 2))
    parts = np.array_split(np.arange(len(theta)), _PANELS)
    frames = [part[lively[part].argmax()] for part in parts]
    sizes = {name: np.linalg.norm(own[frames], axis=-1) for name, own in offsets.items()}
    top_m = scale_top_m(np.stack(list(sizes.values())))
    bodies = {
        name: posed_meshes(smpl, subject.betas, theta[frames], own[frames])
        for name, own in offsets.items()
    }
    camera = frame_camera([body for row in bodies.values() for body in row], height_px=420)
    pictures = [
        [
            render_bodies(
                [body], smpl.data.faces, camera=camera, colours=[magnitude_colours(size, top_m)]
            )
            for body, size in zip(bodies[name], sizes[name], strict=True)
        ]
        for name in offsets
    ]
    draw_panels(
        path,
        pictures,
        title=f"One jump of {subject.name} under both tissue laws",
        origin="synthetic",
        column_titles=[f"{frame / _FPS:.2f} s" for frame in frames],
        row_titles=list(offsets),
        colour_top_m=top_m,
        colour_label="offset",
    )


def compared(offsets: dict[str, NDArray[np.float32]]) -> dict[str, Any]:
    """Sizes under each law, and the share of the second that no multiple of the own explains."""
    lengths = {name: np.linalg.norm(own, axis=-1) * 1000 for name, own in offsets.items()}
    own, second = offsets["own"].astype(np.float64), offsets["second"].astype(np.float64)
    scale = (own * second).sum() / (own**2).sum()
    return {
        **{
            name: {"mean_mm": float(length.mean()), "max_mm": float(length.max())}
            for name, length in lengths.items()
        },
        "unlike": float(((second - scale * own) ** 2).sum() / (second**2).sum()),
    }


if __name__ == "__main__":
    run_as_process(TissueLawsConfig, main)
