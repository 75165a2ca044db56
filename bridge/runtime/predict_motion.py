"""One AMASS motion to a moving body, in one process: NumPy and ONNX Runtime, no framework."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData, load_body_model
from bridge.errors import DsnetError
from bridge.exchange import load_weights
from bridge.exchange.trained_dsnet import TrainedDsnet, load_trained_dsnet
from bridge.motion import Motion, load_amass_motion, unpack_theta
from bridge.report.motion_strip import draw_motion_strip
from bridge.runs import Artifact, ArtifactWriter, Run
from bridge.runs.processes import notify
from bridge.runs.run import body_model_path
from bridge.runtime.onnx_builder import GraphSession
from bridge.runtime.onnx_graphs import decoder_graph
from bridge.runtime.out_folder import open_out_folder
from bridge.runtime.skinning import ShapedBody
from bridge.runtime.streaming import StreamingPredictor

LARGEST_BODY_M, FARTHEST_M = 10.0, 1000.0
"""A shape larger than this is no person's, and a place farther off no motion's."""
_FRAMES_AT_ONCE = 64


def predict_motion(
    run: Run,
    path: Path,
    out: Path,
    *,
    predictor: str | None = None,
    betas: NDArray[np.float64] | None = None,
) -> Artifact:
    """Predict how the run's body moves in one motion, at 60 fps with y up.

    Costs some seconds to start and to draw, and about 10 ms a frame.

    Parameters
    ----------
    path : AMASS `.npz`.
    out : folder to write, see `open_out_folder`: latents (T, 100), offsets (T, V, 3) in the rest
        pose and vertices (T, V, 3), both in metres, `strip.png`, `manifest.json`.
    predictor : which of the run's networks; the run's own choice when None.
    betas : (10,) shape in place of the motion file's.

    Raises
    ------
    DsnetError
        If the run lacks a trained network or its stages are no chain, the file is no motion of a
        body, or `out` holds something else.
    """
    trained, codec = run.artifacts("train", "train-ae").values()
    network = load_trained_dsnet(trained, predictor)
    body = load_body_model(str(body_model_path(run)))
    motion = load_motion(path, body, betas)
    with open_out_folder(out, trained.origin) as writer:
        latents = predict_latents(network, motion)
        writer.put("latents", latents, "latent unit")
        _decode_and_pose(codec, body, motion, latents, writer)
        writer.record(
            predictor=network.name,
            source=path.name,
            source_fps=motion.source_fps,
            fps=motion.fps,
            up=motion.up,
            betas=motion.betas.tolist(),
        )
        upstream = {"train": trained.content_sha256, "train-ae": codec.content_sha256}
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


def predict_latents(network: TrainedDsnet, motion: Motion) -> NDArray[np.float32]:
    """Latents (T, 100) of a motion, from a state without a past."""
    predictor = StreamingPredictor(network)
    betas = motion.betas[None]
    return np.concatenate([predictor.step(theta[None], betas) for theta in motion.theta])


def load_decoder(codec: Artifact) -> GraphSession:
    """The decoder of a finished `train-ae`: `latents` (B, 100) to `offsets` (B, V, 3), metres."""
    arrays = load_weights(codec.file("autoencoder.safetensors"))
    weights = {name.removeprefix("model."): array for name, array in arrays.items()}
    return GraphSession(decoder_graph(weights, codec.manifest["architecture"]))


def _decode_and_pose(
    codec: Artifact,
    body: BodyModelData,
    motion: Motion,
    latents: NDArray[np.float32],
    writer: ArtifactWriter,
) -> None:
    """Write offsets, vertices and the strip."""
    decode, shaped = load_decoder(codec), ShapedBody(body, motion.betas)
    pose, trans = unpack_theta(motion.theta)
    shape = (len(latents), body.vertex_count, 3)
    offsets_m = writer.open_array("offsets", shape, np.float32, "m")
    vertices_m = writer.open_array("vertices", shape, np.float32, "m")
    for start in range(0, len(latents), _FRAMES_AT_ONCE):
        part = slice(start, start + _FRAMES_AT_ONCE)
        offsets_m[part] = decode(latents=latents[part])["offsets"]
        vertices_m[part] = shaped.pose(pose[part], trans[part], offsets_m[part])
        if not np.isfinite(vertices_m[part]).all():
            raise DsnetError(
                f"{motion.source}, whose vertices are not finite from frame {start} on",
                "networks that give finite offsets",
                "Train the run again, or pass another --run.",
            )
    strip = writer.file_path("strip.png")
    draw_motion_strip(strip, vertices_m, offsets_m, body.faces, origin=codec.origin)
