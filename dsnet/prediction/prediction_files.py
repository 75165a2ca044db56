"""One motion to the files of a moving body, in a folder of its own.

From here to the arithmetic: `controlled_body` gives a `MovingBody`; iterating it, `predict_whole`
repeats `Model.step`, which runs the deployable graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bridge.errors import DsnetError
from bridge.runs import Artifact, ArtifactWriter
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.load_model import Source, load_model, name_of
from dsnet.prediction.moving_body import MovedFrames, MovingBody
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.runtimes import Runtime

KIND = "prediction"
WRITABLE = ("offsets", "offsets16", "vertices", "latents", "strip")
OF_ONE, OF_MANY = ("offsets", "vertices", "latents", "strip"), ("offsets",)
"""What is written of one motion, and of each of a folder's, by default."""


def predict_motion(
    source: Source,
    path: Path | str,
    out: Path | str,
    *,
    predictor: str | None = None,
    controls: Controls | None = None,
    write: Sequence[str] = OF_ONE,
    runtime: Runtime = "onnx",
) -> Artifact:
    """Predict how a body moves in one motion, at 60 fps with y up.

    Says on stderr which predictor it took, where the motion has cuts, at which it starts anew, and
    if its rate cannot be right.

    Parameters
    ----------
    source : whose body and predictor, as `load_model` takes it; None for those that come with the
        package, of the motion's gender.
    path : AMASS `.npz`, BVH, or `sample:NAME`.
    out : folder to write, see `open_out_folder`: what `write` names, and `manifest.json`.
    predictor : which of the run's; the run's best when None.
    controls : an animator's options; defaults when None.
    write : of `WRITABLE`: offsets (T, V, 3) in the rest pose and vertices (T, V, 3), both in
        metres, latents (T, 100) if the predictor has them, `strip.png`.
    runtime : what predicts, see `load_model`.

    Raises
    ------
    DsnetError
        If the run lacks the predictor or its stages are no chain, the file is no motion of a
        body, `out` holds something else, and what `controlled_body` raises.
    """
    path, controls = Path(path), controls or Controls()
    controls.check()
    trained, motion = controls.load(source, predictor, path, partial(load_model, runtime=runtime))
    moving = controlled_body(trained, motion, controls)
    with open_out_folder(Path(out), trained.origin, KIND) as writer:
        moving.announce()
        fill_prediction(writer, moving, write, moving.shown("predict"), source=path.name)
        config = {"run": name_of(source), "write": [*write]}
        return writer.finish(config=config, upstream=trained.upstream)


def fill_prediction(
    writer: ArtifactWriter,
    moving: MovingBody,
    write: Sequence[str],
    frames: Iterable[MovedFrames],
    **facts: Any,
) -> None:
    """Write what `write` names of a body's frames, and record how it moves, with other facts."""
    trained, motion, faces = moving.trained, moving.motion, moving.body.faces
    if "latents" in write and (latents := moving.latents) is not None:
        writer.put("latents", latents, "latent unit")
    elif "latents" in write and tuple(write) != OF_ONE:
        raise DsnetError(
            f"--write latents of {trained.name}, which has none",
            "a predictor with an autoencoder",
            "Leave latents out, or pass another --predictor.",
        )
    shape, made, largest_m2 = (len(moving), moving.body.vertex_count, 3), {}, 0.0
    for word in write:
        if word in ("offsets", "offsets16", "vertices"):
            dtype = np.float16 if word == "offsets16" else np.float32
            name = word.removesuffix("16")
            made[name] = writer.array_file(name, shape, dtype, "m")
    for moved in frames:
        # In float64, in which no finite offset is too large to be squared.
        lengths_m2 = np.einsum("tvx,tvx->tv", *2 * [moved.offsets_m], dtype=np.float64)
        largest_m2 = max(largest_m2, float(lengths_m2.max(initial=0.0)))
        for name, array in made.items():
            array.write(moved.frames.start, getattr(moved, f"{name}_m"))
    if "strip" in write:
        # Matplotlib takes longer to load than the first frames, which do not wait for it.
        from dsnet.pictures.panels import draw_motion_strip

        drawn_m = made["vertices"].read(slice(None)), made["offsets"].read(slice(None))
        draw_motion_strip(writer.file_path("strip.png"), *drawn_m, faces, origin=trained.shows)
    writer.record(
        predictor=trained.name,
        label=trained.label,
        why=trained.why,
        runtime=trained.runtime,
        source_fps=motion.source_fps,
        fps=motion.fps,
        frames=len(moving),
        largest_offset_mm=round(1000 * largest_m2**0.5, 1),
        up=motion.up,
        body_model=moving.body.name,
        betas=motion.betas.tolist(),
        controls=moving.controls,
        starts_anew_at=[piece.start for piece in moving.pieces[1:]],
        **facts,
    )
