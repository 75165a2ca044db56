"""One AMASS motion to a moving body, in one process: NumPy and ONNX Runtime, no framework."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runtime.characters import open_for_motion
from bridge.runtime.controls import Controls, controlled_body
from bridge.runtime.moving_body import MovingBody, announce
from bridge.runtime.out_folder import open_out_folder


def predict_motion(
    run: Run | None,
    path: Path | str,
    out: Path | str,
    *,
    predictor: str | None = None,
    controls: Controls | None = None,
    strip: bool = True,
) -> Artifact:
    """Predict how a body moves in one motion, at 60 fps with y up.

    Says on stderr which predictor it took, where the motion has cuts, at which it starts anew, and
    if its rate cannot be right.

    Parameters
    ----------
    run : whose body and predictor; None for those that come with the package, of the motion's
        gender.
    path : AMASS `.npz`, BVH, or `sample:NAME`.
    out : folder to write, see `open_out_folder`: offsets (T, V, 3) in the rest pose and vertices
        (T, V, 3), both in metres, latents (T, 100) if the predictor has them, `strip.png`,
        `manifest.json`.
    predictor : which of the run's; the run's best when None.
    controls : what an animator asks for; nothing when None.
    strip : whether to draw `strip.png`.

    Raises
    ------
    DsnetError
        If the run lacks the predictor or its stages are no chain, the file is no motion of a
        body, `out` holds something else, and what `controlled_body` raises.
    """
    path, out = Path(path), Path(out)
    controls = Controls() if controls is None else controls
    controls.check()
    character, motion = open_for_motion(
        run, predictor, path, controls.motion_fps, controls.smooth_hz
    )
    moving = controlled_body(character, motion, controls)
    chosen, motion = character.chosen, moving.motion
    with open_out_folder(out, chosen.trained.origin) as writer:
        announce(moving)
        _write(moving, writer, strip=strip)
        writer.record(
            predictor=chosen.name,
            label=chosen.label,
            why=chosen.why,
            source=path.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
            up=motion.up,
            betas=motion.betas.tolist(),
            controls=moving.controls,
            starts_anew_at=[piece.start for piece in moving.pieces[1:]],
        )
        return writer.finish(config={"run": run and run.name}, upstream=chosen.upstream)


def _write(moving: MovingBody, writer: ArtifactWriter, *, strip: bool) -> None:
    """Write vertices and offsets (T, V, 3), latents if there are any, and the strip."""
    if (latents := moving.latents) is not None:
        writer.put("latents", latents, "latent unit")
    shape = (len(moving), moving.character.body.vertex_count, 3)
    offsets_m = writer.open_array("offsets", shape, np.float32, "m")
    vertices_m = writer.open_array("vertices", shape, np.float32, "m")
    for posed in moving.shown("predict"):
        offsets_m[posed.frames] = posed.offsets_m
        vertices_m[posed.frames] = posed.vertices_m
    if strip:
        _draw(writer, vertices_m, offsets_m, moving)


def _draw(writer: ArtifactWriter, vertices_m: NDArray, offsets_m: NDArray, of: MovingBody) -> None:
    # Matplotlib takes longer to load than the first frames, which do not wait for it.
    from bridge.report.panels import draw_motion_strip

    path, character = writer.file_path("strip.png"), of.character
    origin = character.chosen.trained.origin
    draw_motion_strip(path, vertices_m, offsets_m, character.body.faces, origin=origin)
