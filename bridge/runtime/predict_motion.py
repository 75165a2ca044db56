"""One AMASS motion to a moving body, in one process: NumPy and ONNX Runtime, no framework."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.errors import DsnetError
from bridge.motion import Motion, load_amass_motion, unpack_theta
from bridge.motion.cuts import cut_warning, pieces_between_cuts
from bridge.report.motion_strip import draw_motion_strip
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.processes import notify
from bridge.runs.run import body_model_path
from bridge.runtime.bounds import FARTHEST_M, LARGEST_BODY_M
from bridge.runtime.dsnet_motion import DSNET
from bridge.runtime.motion_predictor import MotionPredictor, choose_predictor
from bridge.runtime.out_folder import open_out_folder
from bridge.runtime.plus_motion import PLUS
from bridge.runtime.skinning import ShapedBody

ROADS = (PLUS, DSNET)
"""Whose predictors can be asked for, the best first."""


def predict_motion(
    run: Run,
    path: Path,
    out: Path,
    *,
    predictor: str | None = None,
    betas: NDArray[np.float64] | None = None,
) -> Artifact:
    """Predict how the run's body moves in one motion, at 60 fps with y up.

    Says on stderr which predictor it took, and where the motion has cuts: there it starts anew.
    Costs some seconds to start and to draw, and about 10 ms a frame.

    Parameters
    ----------
    path : AMASS `.npz`.
    out : folder to write, see `open_out_folder`: offsets (T, V, 3) in the rest pose and vertices
        (T, V, 3), both in metres, latents (T, 100) if the predictor has them, `strip.png`,
        `manifest.json`.
    predictor : which of the run's; the run's best when None.
    betas : (10,) shape in place of the motion file's.

    Raises
    ------
    DsnetError
        If the run lacks the predictor or its stages are no chain, the file is no motion of a
        body, or `out` holds something else.
    """
    chosen = choose_predictor(run, predictor, ROADS)
    body = load_body_model(str(body_model_path(run)))
    predict = chosen.open(body)
    motion = load_motion(path, body, betas)
    pieces = pieces_between_cuts(motion.theta)
    trained = chosen.artifacts[chosen.road.stages[0]]
    with open_out_folder(out, trained.origin) as writer:
        notify(f"{chosen.name} ({chosen.label}) of run {run.name!r} predicts: {chosen.why}")
        if warning := cut_warning(path, pieces, motion.fps):
            notify(warning)
        drawn = _predict_and_pose(predict, body, motion, pieces, writer)
        draw_motion_strip(writer.file_path("strip.png"), *drawn, body.faces, origin=trained.origin)
        writer.record(
            predictor=chosen.name,
            label=chosen.label,
            why=chosen.why,
            source=path.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
            up=motion.up,
            betas=motion.betas.tolist(),
            starts_anew_at=[piece.start for piece in pieces[1:]],
        )
        upstream = {stage: made.content_sha256 for stage, made in chosen.artifacts.items()}
        return writer.finish(config={"run": run.name}, upstream=upstream)


def load_motion(path: Path, body: BodyModelData, betas: NDArray[np.float64] | None) -> Motion:
    """Read a motion, turned to y up about the root joint of the body that will be posed.

    Raises
    ------
    DsnetError
        If the file is no motion, or not one of a body of a person's size.
    """
    motion = load_amass_motion(path)
    if betas is not None:
        motion = replace(motion, betas=betas)
    elif {motion.gender, body.gender} == {"female", "male"}:
        notify(f"the betas of {path} are a {motion.gender}'s, the body {body.gender}: see --betas")
    with np.errstate(over="ignore", invalid="ignore"):
        rest = body.v_template + body.shapedirs @ motion.betas
        size_m, far_m = np.ptp(rest, axis=0).max(), np.abs(unpack_theta(motion.theta)[1]).max()
    if not (size_m < LARGEST_BODY_M and far_m < FARTHEST_M):
        raise DsnetError(
            f"{path}, a body of {size_m:.3g} m that moves {far_m:.3g} m off",
            f"a person within {FARTHEST_M:g} m of the origin",
            "Check the file's betas and trans; --betas gives another shape.",
        )
    return motion.about_root_joint((body.J_regressor @ rest)[0])


def _predict_and_pose(
    predict: MotionPredictor,
    body: BodyModelData,
    motion: Motion,
    pieces: Sequence[slice],
    writer: ArtifactWriter,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Write vertices and offsets (T, V, 3), which are returned, and latents if there are any."""
    predictions = [predict(motion.theta[piece], motion.betas) for piece in pieces]
    latents = [found.latents for found in predictions if found.latents is not None]
    if latents:
        writer.put("latents", np.concatenate(latents), "latent unit")
    pose, trans = unpack_theta(motion.theta)
    shape = (len(motion.theta), body.vertex_count, 3)
    offsets_m = writer.open_array("offsets", shape, np.float32, "m")
    vertices_m = writer.open_array("vertices", shape, np.float32, "m")
    shaped, start = ShapedBody(body, motion.betas), 0
    for found_m in chain.from_iterable(found.offsets_m for found in predictions):
        part = slice(start, start + len(found_m))
        offsets_m[part] = found_m
        vertices_m[part] = shaped.pose(pose[part], trans[part], found_m)
        if not np.isfinite(vertices_m[part]).all():
            raise DsnetError(
                f"{motion.source}, whose vertices are not finite from frame {start} on",
                "a predictor that gives finite offsets",
                "Train the run again, or pass another --run.",
            )
        start = part.stop
    return vertices_m, offsets_m
