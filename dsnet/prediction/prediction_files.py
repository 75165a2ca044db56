"""One motion to the files of a moving body, in a folder of its own.

From here to the arithmetic: `controlled_body` gives a `MovingBody`; iterating it, `predict_whole`
repeats `Model.step`, which runs the deployable graph.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.body.parts import PARTS
from bridge.body.vertex_order import VERTICES, vertex_order
from bridge.errors import DsnetError, notify
from bridge.motion.readers import is_smpl_family
from bridge.runs import Artifact, ArtifactWriter
from bridge.runs.files import ArrayFile
from bridge.tissue.trained_plus import NAME as PLUS
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.flesh import KIND
from dsnet.prediction.interpolation import Interpolation
from dsnet.prediction.load_model import Source, TrainedModel, load_model, name_of, requested_body
from dsnet.prediction.models import PlusModel
from dsnet.prediction.moving_body import MovedFrames, MovingBody
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.runtimes import Runtime

OFFSETS = ("offsets", "offsets16", "nodes16")
"""Offsets (T, V, 3) as float32 or float16, or those of the nodes, float16, of which they are made.
With those of a folder, and with nodes, comes `theta` (T, 69), the motion that they belong to."""
WRITABLE = (*OFFSETS, "vertices", "latents", "strip")
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
        metres, latents (T, 100) if the predictor has them, `strip.png`; offsets16 and nodes16 are
        other forms of offsets, which `load_flesh` reads.
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
    of_betas = controls.use_of_betas(motion, trained.body)
    with open_out_folder(Path(out), trained.origin, KIND) as writer:
        moving.announce()
        if (
            moving.body.source == "synthetic"
            and not requested_body(controls.body)
            and is_smpl_family(path)
        ):
            notify(
                f"moves {moving.body.name}, with vertices in another order than SMPL's: --body "
                "BODY moves yours, --body embedded says that this is meant"
            )
        frames = moving.shown("predict")
        fill_prediction(writer, moving, write, frames, source=path.name, file_betas=of_betas)
        config = {"run": name_of(source), "write": [*write]}
        return writer.finish(config=config, upstream=trained.upstream)


def fill_prediction(
    writer: ArtifactWriter,
    moving: MovingBody,
    write: Sequence[str],
    frames: Iterable[MovedFrames],
    shared: Path | None = None,
    **facts: Any,
) -> None:
    """Write what `write` names of a body's frames, and record how it moves, with other facts.

    The interpolation of nodes goes to the folder `shared`, where others have it too, or to the
    prediction's own.
    """
    trained, motion, body = moving.trained, moving.motion, moving.body
    if "latents" in write and (latents := moving.latents) is not None:
        writer.put("latents", latents, "latent unit")
    elif "latents" in write and tuple(write) != OF_ONE:
        raise DsnetError(
            f"--write latents of {trained.name}, which has none",
            "a predictor with an autoencoder",
            "Leave latents out, or pass another --predictor.",
        )
    shape, largest_m2, least = (len(moving), body.vertex_count, 3), 0.0, np.inf
    made: dict[str, tuple[ArrayFile, Callable[[MovedFrames], NDArray[np.floating]]]] = {}
    if "nodes16" in write:
        nodes, read = _nodes_of(writer, moving, shared)
        made["nodes"] = writer.array_file("nodes", (len(moving), nodes, 3), np.float16, "m"), read
        if moving.gains.limited:
            gains = writer.array_file("gains", (len(moving), len(PARTS)), np.float32, "1")
            made["gains"] = gains, attrgetter("gains")
    for word in [one for one in write if one in ("offsets", "offsets16", "vertices")]:
        dtype = np.float16 if word == "offsets16" else np.float32
        name = word.removesuffix("16")
        made[name] = writer.array_file(name, shape, dtype, "m"), attrgetter(f"{name}_m")
    if "nodes16" in write or (shared and {*OFFSETS} & {*write}):
        writer.put("theta", motion.theta.astype(np.float32), "rad, last three m")
    for moved in frames:
        # In float64, in which no finite offset is too large to be squared.
        lengths_m2 = np.einsum("tvx,tvx->tv", *2 * [moved.offsets_m], dtype=np.float64)
        largest_m2 = max(largest_m2, float(lengths_m2.max(initial=0.0)))
        if moved.gains is not None:
            least = min(least, float(moved.gains[:, moving.gains.of_parts > 1].min(initial=least)))
        for array, read in made.values():
            array.write(moved.frames.start, read(moved))
    if "strip" in write:
        # Matplotlib takes longer to load than the first frames, which do not wait for it.
        from dsnet.pictures.panels import draw_motion_strip

        vertices_m, offsets_m = (made[n][0].read(slice(None)) for n in ("vertices", "offsets"))
        path = writer.file_path("strip.png")
        draw_motion_strip(path, vertices_m, offsets_m, body.faces, origin=trained.shows)
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
        body_model=body.name,
        gender=body.gender,
        betas=motion.betas.tolist(),
        controls=moving.controls,
        **({"least_gain": round(least, 2)} if moving.gains.limited else {}),
        starts_anew_at=[piece.start for piece in moving.pieces[1:]],
        **{VERTICES: vertex_order(body)},
        **facts,
    )


def node_count(trained: TrainedModel) -> int:
    """How many nodes carry the flesh; `DsnetError` of a predictor that has none."""
    return len(_plus(trained).nodes)


def _plus(trained: TrainedModel) -> TrainedPlus:
    if not isinstance(trained.model, PlusModel):
        raise DsnetError(
            f"--write nodes16 of {trained.name}, which has no nodes",
            f"{PLUS}, which has",
            "Pass offsets16, or latents, or another --predictor.",
        )
    return trained.model.trained


def _nodes_of(
    writer: ArtifactWriter, moving: MovingBody, shared: Path | None
) -> tuple[int, Callable[[MovedFrames], NDArray[np.float32]]]:
    """How many nodes there are, and who reads their offsets (T', K, 3) off a body's frames.

    A node sits at a vertex, which takes all of it and nothing of the others: what the skin does
    there, before any gain and without a person's constant, is the node's offset. Gains are in the
    interpolation, or, where strain limits them, in an array of their own.
    """
    nodes, gains = _plus(moving.trained).nodes, moving.gains
    gain, fading = (1.0, gains.shares) if gains.limited else (gains.unlimited, None)
    shares = (nodes.shares * gain).astype(np.float32)
    interpolation = Interpolation(nodes.owners, shares, len(nodes), fading)
    constant_m = _plus(moving.trained).constant_m(moving.motion.betas)
    if constant_m is not None and constant_m.any():
        writer.put("constant", (constant_m * gain).astype(np.float32), "m")
    else:
        constant_m = np.zeros((len(nodes.owners), 3), np.float32)
    interpolation.save(shared or writer.file_path(interpolation.name(interpolation.digest)).parent)
    writer.record(interpolation=interpolation.digest)
    at, constant_m = nodes.vertices, constant_m[nodes.vertices]
    return len(nodes), lambda moved: moved.predicted_m[:, at] - constant_m
