"""`dsnet predict --motion FOLDER`: every motion below a folder, into a tree of the same shape.

`OUT/Subject/walk_poses/` is the prediction of `FOLDER/Subject/walk_poses.npz`. What is there, made
of the same file as is requested now, is not made again, so the same command goes on after a kill.
A file that cannot be predicted is named at the end and stops no other.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path

from bridge.body.embedded import EMBEDDED, EMBEDDED_GENDERS
from bridge.body.vertex_order import VERTICES
from bridge.errors import DsnetError, notify
from bridge.motion.readers import files_below, stated_gender
from bridge.motion.readers.recordings import recording_beside
from bridge.runs import read_artifact
from bridge.runs.files import (
    MANIFEST,
    exclusive,
    is_finished,
    runs_root,
    sha256_of,
    stamp_of,
    tidy,
    write_text_atomically,
)
from bridge.runs.workers import WorkerPool, on_any_node, progress, worker_pool
from dsnet.prediction.controls import Controls
from dsnet.prediction.folder_bodies import refuse_unnamed_body, report_bodies
from dsnet.prediction.folder_job import FolderJob, MotionJob
from dsnet.prediction.interpolation import Interpolation
from dsnet.prediction.load_model import Source, find_model, requested_body
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.prediction_files import KIND, OF_MANY, fill_prediction
from dsnet.prediction.runtimes import Runtime

REFUSED = "refused.txt"
"""In the folder that is written: each file that was refused, and why."""
_SHOWN = 20
"""Refusals that are listed on the terminal; the file has all."""
_BESIDE_BYTES = 8192
"""Of a motion's manifest and the headers of its arrays."""


def predict_folder(
    source: Source,
    folder: Path,
    out: Path,
    *,
    predictor: str | None = None,
    controls: Controls | None = None,
    write: Sequence[str] = OF_MANY,
    runtime: Runtime = "onnx",
) -> None:
    """Predict every motion below a folder; parameters are those of `predict_motion`.

    Files without a motion, as AMASS's `shape.npz`, are passed over. Before anything is written the
    room that all takes is printed, and whose body moves. Workers are processes, or nodes with
    `--engine ray`.

    Raises
    ------
    DsnetError
        If there is no motion, `out` lies in a run or in `folder`, the disk lacks room, or motions
        of SMPL's bodies would move an embedded one that is not asked for; and, when all others are
        written, if some file was refused, which `out/refused.txt` has.
    """
    controls = controls or Controls()
    if body_name := requested_body(controls.body):  # other machines have other settings and folders
        is_file = body_name != EMBEDDED and Path(body_name).exists()
        controls = replace(controls, body=Path(body_name).resolve() if is_file else Path(body_name))
    job = FolderJob(source, predictor, controls, tuple(write), out.resolve(), runtime)
    job.controls.check()
    job.controls.how_read()
    _refuse_place(folder, out)
    models = _upstreams(source, predictor)
    files = _files(folder.resolve(), out.resolve())
    if not body_name:
        refuse_unnamed_body(source, predictor, folder.resolve(), (one.path for one in files))
    with (
        exclusive(out, f"--out {out}", "Wait until it has ended, or name another folder."),
        worker_pool(on_any_node("processes"), job) as pool,
    ):
        done = {one.path: one for one in map(partial(_done, job, models), files) if one}
        for one in done.values():
            tidy(one.out)
        surveyed = _surveyed([one for one in files if one.path not in done], pool)
        if not done and not surveyed:
            raise DsnetError(
                f"--motion {folder}, a folder with {len(files)} files that might be motions",
                "at least one motion in it",
                "Check the path: docs/motion_files.md has what is read.",
            )
        motions = [one for one in surveyed if not one.refusal]
        report_bodies([(one.body, one.of_betas) for one in (*done.values(), *motions)])
        _refuse_lack_of_room(out, motions, len(done))
        refused = [one for one in surveyed if one.refusal] + _predicted(motions, pool)
        _report(out, refused, len(done) + len(surveyed))


def _refuse_place(folder: Path, out: Path) -> None:
    whole, source = out.resolve(), folder.resolve()
    if source in (whole, *whole.parents):
        raise DsnetError(
            f"--out {out}, which lies in --motion {folder}",
            "a folder outside it: what is written would be read as motions",
            "Name another folder.",
        )
    if runs_root().resolve() in whole.parents or is_finished(out):
        kind = "a prediction" if is_finished(out) else "a place in the runs"
        raise DsnetError(f"--out {out}, {kind}", "an empty folder", "Name another folder.")


def _upstreams(source: Source, predictor: str | None) -> list[dict[str, str]]:
    """What predictions are made of: one model's artifacts, or those of either gender's."""
    if source is not None:
        return [find_model(source, predictor).upstream]
    return [find_model(None, predictor, gender).upstream for gender in EMBEDDED_GENDERS]


def _files(folder: Path, out: Path) -> list[MotionJob]:
    """In order of path; the endings of names stay where a folder would be another's too."""
    paths = [path for path in files_below(folder) if path.is_file()]
    taken = Counter(path.with_suffix("") for path in paths)
    taken.update({folder / REFUSED, *(parent for path in paths for parent in path.parents)})

    def place(path: Path) -> Path:
        whole = path if taken[path.with_suffix("")] > 1 else path.with_suffix("")
        return out / whole.relative_to(folder)

    return [MotionJob(path, str(path.relative_to(folder)), place(path)) for path in paths]


def _done(job: FolderJob, models: Sequence[dict[str, str]], one: MotionJob) -> MotionJob | None:
    """What is requested, if it was made of the file as it is."""
    if not is_finished(one.out):
        return None
    try:
        made = read_artifact(one.out, KIND)
    except DsnetError:  # damaged, and about to be made again
        return None
    upstream = made.manifest["upstream"]
    present = {
        name: made.present_sha256(path, str(path), upstream.get(name, ""))
        for name, path in _files_read(one.path).items()
    }
    made_of = [model | present for model in models]
    if made.manifest["config"] != job.config or upstream not in made_of:
        return None
    interpolation = made.manifest.get("interpolation")
    if VERTICES not in made.manifest or (interpolation and not _has(job, interpolation)):
        return None  # of a version that did not say its order, or without what its nodes mean
    return replace(one, body=made.manifest["body_model"], of_betas=made.manifest["file_betas"])


def _has(job: FolderJob, interpolation: str) -> bool:
    return (job.shared / Interpolation.name(interpolation)).is_file()


def _files_read(motion: Path) -> dict[str, Path]:
    """What a prediction is made of: a motion, and markers beside it."""
    markers = recording_beside(motion)
    return {"motion": motion} if markers is None else {"motion": motion, "markers": markers}


def _surveyed(files: Sequence[MotionJob], pool: WorkerPool[FolderJob]) -> list[MotionJob]:
    """What each file holds, without those that hold no motion."""
    seen = progress(pool.map(_survey, files), what="look", unit="file", total=len(files))
    return [one for one in seen if one is not None]


def _survey(job: FolderJob, one: MotionJob) -> MotionJob | None:
    try:
        if stated_gender(one.path) is None:
            return None
        with redirect_stderr(StringIO()):  # warnings come when the motion is predicted
            trained, motion = job.load(one.path)
        bytes_a_frame = job.bytes_a_frame(trained)
    except DsnetError as error:
        return _refused(one, error)
    frames = len(motion.theta)
    return replace(
        one,
        frames=frames,
        bytes=frames * bytes_a_frame + _BESIDE_BYTES,
        body=trained.body.name,
        of_betas=job.controls.use_of_betas(motion, trained.body),
    )


def _refuse_lack_of_room(out: Path, motions: Sequence[MotionJob], done: int) -> None:
    """Say what will be written, and refuse it where the disk has no room for it."""
    wanted, free = sum(one.bytes for one in motions), shutil.disk_usage(out.parent).free
    frames = sum(one.frames for one in motions)
    room = f"{_size(wanted)} to write, {_size(free)} free"
    notify(f"{done} motions are done, {len(motions)} of {frames} frames to do: {room}")
    if wanted > free:
        raise DsnetError(
            f"--out {out}, on a disk with {_size(free)} free",
            f"{_size(wanted)} for {frames} frames",
            "Make room, name another disk, or pass --write nodes16, the smallest form.",
        )


def _size(count: float) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _predicted(motions: Sequence[MotionJob], pool: WorkerPool[FolderJob]) -> list[MotionJob]:
    """Predict them; those that cannot be."""
    tried, total = [], sum(one.frames for one in motions)
    with progress(what="predict", unit="frame", total=total) as bar:
        for one in pool.map(_predict, motions):
            bar.update(one.frames)
            tried.append(one)
    if count := sum(one.warnings > 0 for one in tried):
        notify(f"of {count} there are warnings, under `told` in their {MANIFEST}")
    return [one for one in tried if one.refusal]


def _predict(job: FolderJob, one: MotionJob) -> MotionJob:
    try:
        moving, of_betas, warnings = job.moving(one.path)
        read = _files_read(one.path)
        stamps = {str(path): stamp_of(path) for path in read.values()}
        digests = {name: sha256_of(path) for name, path in read.items()}
        upstream = {**moving.trained.upstream, **digests}
        with open_out_folder(one.out, moving.trained.origin, KIND) as writer:
            about = {"source": one.path.name, "file_betas": of_betas, "told": warnings}
            fill_prediction(writer, moving, job.write, moving, job.shared, **about)
            writer.record_inputs({name: str(path) for name, path in read.items()}, stamps)
            writer.finish(config=job.config, upstream=upstream)
    except DsnetError as error:
        if isinstance(error.__cause__, OSError) and str(error).startswith("--out"):
            raise  # a full disk is no fault of the motion's
        return _refused(one, error)
    return replace(one, warnings=len(warnings))


def _refused(one: MotionJob, error: DsnetError) -> MotionJob:
    refusal = str(error).replace(str(one.path), one.name)
    return replace(one, refusal=refusal if one.name in refusal else f"{one.name}: {refusal}")


def _report(out: Path, refused: Sequence[MotionJob], motions: int) -> None:
    """Say which motions were refused, and end so."""
    path = out / REFUSED
    path.unlink(missing_ok=True)
    if not refused:
        notify(f"{motions} motions are in {out}")
        return
    lines = [one.refusal for one in refused]
    out.mkdir(exist_ok=True)
    write_text_atomically(path, "\n".join(lines) + "\n")
    for line in lines[:_SHOWN]:
        notify(line)
    more = f" and {len(lines) - _SHOWN} more" if len(lines) > _SHOWN else ""
    raise DsnetError(
        f"{len(refused)} of {motions} files, refused as listed above{more} and in {path}",
        "motions of bodies",
        "All others are written; mend these and run the same command.",
    )
