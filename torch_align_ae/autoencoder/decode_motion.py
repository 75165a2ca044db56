"""`python -m torch_align_ae.autoencoder.decode_motion`: latents and a motion to a moving body.

The last of the three processes of `dsnet predict --motion`: decodes the latents, poses the body
with the offsets added in its rest pose, and draws a strip to look at.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from bridge.body import load_body_model
from bridge.motion import unpack_theta
from bridge.report.motion_strip import draw_motion_strip
from bridge.runs import Artifact, ArtifactWriter, Run, read_artifact
from bridge.runs.processes import run_as_process
from bridge.runs.run import body_model_path
from torch_align_ae.autoencoder.codec import load_codec
from torch_align_ae.body import SMPL

_FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class DecodeMotionConfig:
    """Decode predicted latents and pose the body."""

    run: str
    """Run whose autoencoder decodes."""
    motion: Path
    """Artifact with `theta` (T, 69) and `betas` (10,)."""
    latents: Path
    """Artifact with `latents` (T, 100)."""
    out: Path
    """Folder to write: latents, offsets, vertices, strip.png."""


def main(config: DecodeMotionConfig) -> None:
    """Write the `prediction` artifact: latents, offsets (rest pose), vertices (world, y up)."""
    run = Run(config.run)
    motion = read_artifact(config.motion, "motion")
    latents = np.asarray(read_artifact(config.latents).array("latents"))
    writer = ArtifactWriter(config.out, "prediction", data=motion.origin)
    writer.put("latents", latents, "1")
    _decode_and_pose(run, motion, latents, writer)
    kept = ("source", "source_fps", "fps")
    writer.record(up="y", betas=motion.array("betas").tolist(), **_pick(motion, kept))
    trained = {stage: run.artifact(stage).content_sha256 for stage in ("train", "train-ae")}
    writer.finish(config={"run": config.run}, upstream=trained)


def _decode_and_pose(
    run: Run, motion: Artifact, latents: np.ndarray, writer: ArtifactWriter
) -> None:
    body = load_body_model(str(body_model_path(run)))
    codec, smpl = load_codec(run.artifact("train-ae")), SMPL(body)
    pose, trans = unpack_theta(motion.array("theta"))
    betas = torch.from_numpy(np.array(motion.array("betas"), dtype=np.float32))
    shape = (len(latents), smpl.vertex_count, 3)
    offsets_m = writer.open_array("offsets", shape, np.float32, "m")
    vertices_m = writer.open_array("vertices", shape, np.float32, "m")
    for start in range(0, len(latents), _FRAMES_AT_ONCE):
        part = slice(start, min(start + _FRAMES_AT_ONCE, len(latents)))
        offsets_m[part] = codec.decode(latents[part])
        with torch.inference_mode():
            vertices_m[part] = smpl(
                betas.expand(part.stop - start, -1),
                torch.from_numpy(np.array(pose[part], dtype=np.float32)),
                torch.from_numpy(np.array(trans[part], dtype=np.float32)),
                torch.from_numpy(np.array(offsets_m[part])),
            ).numpy()
    draw_motion_strip(
        writer.file_path("strip.png"), vertices_m, offsets_m, body.faces, origin=motion.origin
    )


def _pick(artifact: Artifact, keys: tuple[str, ...]) -> dict[str, object]:
    return {key: artifact.manifest[key] for key in keys}


if __name__ == "__main__":
    run_as_process(DecodeMotionConfig, main)
