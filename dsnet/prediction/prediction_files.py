"""One motion to the files of a moving body, in a folder that is nobody else's.

From here to the arithmetic: `controlled_body` gives a `MovingBody`; iterating it, `predict_whole`
repeats `Model.step`, which runs the deployable graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bridge.errors import DsnetError
from bridge.runs import Artifact, ArtifactWriter, Run, read_artifact
from bridge.runs.artifact import DataOrigin
from bridge.runs.files import MANIFEST, exclusive, runs_root
from dsnet.prediction.controls import Controls, controlled_body
from dsnet.prediction.moving_body import MovedFrames, MovingBody

KIND = "prediction"
WRITABLE = ("offsets", "offsets16", "vertices", "latents", "strip")
OF_ONE, OF_MANY = ("offsets", "vertices", "latents", "strip"), ("offsets",)
"""What is written of one motion, and of each of a folder's, unless something else is asked for."""


def predict_motion(
    run: Run | None,
    path: Path | str,
    out: Path | str,
    *,
    predictor: str | None = None,
    controls: Controls | None = None,
    write: Sequence[str] = OF_ONE,
) -> Artifact:
    """Predict how a body moves in one motion, at 60 fps with y up.

    Says on stderr which predictor it took, where the motion has cuts, at which it starts anew, and
    if its rate cannot be right.

    Parameters
    ----------
    run : whose body and predictor; None for those that come with the package, of the motion's
        gender.
    path : AMASS `.npz`, BVH, or `sample:NAME`.
    out : folder to write, see `open_out_folder`: what is asked for, and `manifest.json`.
    predictor : which of the run's; the run's best when None.
    controls : what an animator asks for; nothing when None.
    write : of `WRITABLE`: offsets (T, V, 3) in the rest pose and vertices (T, V, 3), both in
        metres, latents (T, 100) if the predictor has them, `strip.png`.

    Raises
    ------
    DsnetError
        If the run lacks the predictor or its stages are no chain, the file is no motion of a
        body, `out` holds something else, and what `controlled_body` raises.
    """
    path, controls = Path(path), controls or Controls()
    controls.check()
    trained, motion = controls.load(run, predictor, path)
    moving = controlled_body(trained, motion, controls)
    with open_out_folder(Path(out), trained.origin) as writer:
        moving.announce()
        fill_prediction(writer, moving, write, moving.shown("predict"), source=path.name)
        config = {"run": run and run.name, "write": [*write]}
        return writer.finish(config=config, upstream=trained.upstream)


def fill_prediction(
    writer: ArtifactWriter,
    moving: MovingBody,
    write: Sequence[str],
    frames: Iterable[MovedFrames],
    **facts: Any,
) -> None:
    """Write what is asked for of a body's frames, and record how it moves, with other facts."""
    trained, motion, faces = moving.trained, moving.motion, moving.body.faces
    if "latents" in write and (latents := moving.latents) is not None:
        writer.put("latents", latents, "latent unit")
    elif "latents" in write and tuple(write) != OF_ONE:
        raise DsnetError(
            f"--write latents of {trained.name}, which has none",
            "a predictor with an autoencoder",
            "Leave latents out, or pass another --predictor.",
        )
    shape, made = (len(moving), moving.body.vertex_count, 3), {}
    for word in write:
        if word in ("offsets", "offsets16", "vertices"):
            dtype = np.float16 if word == "offsets16" else np.float32
            name = word.removesuffix("16")
            made[name] = writer.array_file(name, shape, dtype, "m")
    for moved in frames:
        for name, array in made.items():
            array.write(moved.frames.start, getattr(moved, f"{name}_m"))
    if "strip" in write:
        # Matplotlib takes longer to load than the first frames, which do not wait for it.
        from dsnet.report.panels import draw_motion_strip

        drawn_m = made["vertices"].read(slice(None)), made["offsets"].read(slice(None))
        draw_motion_strip(writer.file_path("strip.png"), *drawn_m, faces, origin=trained.shows)
    writer.record(
        predictor=trained.name,
        label=trained.label,
        why=trained.why,
        source_fps=motion.source_fps,
        fps=motion.fps,
        up=motion.up,
        body_model=moving.body.name,
        betas=motion.betas.tolist(),
        controls=moving.controls,
        starts_anew_at=[piece.start for piece in moving.pieces[1:]],
        **facts,
    )


@contextmanager
def open_out_folder(out: Path, origin: DataOrigin, kind: str = KIND) -> Iterator[ArtifactWriter]:
    """A writer of the artifact of a kind that will be `out`; an exception leaves nothing.

    A finished artifact replaces the folder of its name with all that is in it, so one that is in a
    run, or holds anything but an earlier one of its kind, is refused; one process at a time writes.
    """
    out = out.resolve()
    _refuse_foreign(out, kind)
    try:
        with exclusive(out, f"--out {out}", "Wait until it has ended, or name another folder."):
            _refuse_foreign(out, kind)  # once more: it may have been filled before we were alone
            yield ArtifactWriter(out, kind, data=origin)
    except OSError as error:
        raise DsnetError(
            f"--out {out}, which cannot be written ({error.strerror or error})",
            "a folder that can be made, on a disk with room",
            "Name another folder.",
        ) from error


def _refuse_foreign(out: Path, kind: str) -> None:
    if out.exists() and not out.is_dir():
        raise DsnetError(f"--out {out}, a file", "a folder to write", "Name another path.")
    if out.parent.parent == runs_root().resolve():
        raise DsnetError(
            f"--out {out}, a place for a stage of run {out.parent.name!r}",
            "a folder outside of the runs",
            "Name another folder.",
        )
    if out.is_dir() and (held := _foreign(out, kind)):
        raise DsnetError(
            f"--out {out}, which holds {held}",
            f"a new or empty folder, or one of an earlier {kind} and nothing else",
            "Name another folder.",
        )


def _foreign(out: Path, kind: str) -> str:
    """What in a folder is not of an earlier artifact of a kind, empty if nothing is."""
    there = min(out.iterdir(), default=None)
    if there is None:
        return ""
    try:
        artifact = read_artifact(out)
    except DsnetError:
        return f"other files such as {there.name}"
    if artifact.manifest["kind"] != kind:
        return f"an artifact of kind {artifact.manifest['kind']!r}"
    own = {MANIFEST, *artifact.digests}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if name not in own and (path.is_symlink() or not path.is_dir()):
            return f"{name} beside an earlier {kind}"
    return ""
