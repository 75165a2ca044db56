"""`dsnet train --markers`: a `dsnet_plus` with soft-tissue constants fitted to skin markers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.errors import DsnetError, notify
from bridge.exchange import save_weights
from bridge.exchange.weights import refuse_nonfinite
from bridge.motion.readers import files_below, read_motion_file
from bridge.paper import N_BETAS
from bridge.runs import ArtifactWriter, Run
from bridge.runs.files import json_sha256, sha256_of, write_text_atomically
from bridge.runs.run import TRAIN_MARKERS, TRAIN_PLUS
from bridge.runs.workers import progress, worker_pool
from bridge.tissue.trained_plus import NAME, TrainedPlus, shares_of_people
from dsnet.fitting.fit import Estimate, fit_subject
from dsnet.fitting.population import RegionFit, combine
from dsnet.fitting.recording import Recording, read_recording
from dsnet.fitting.tissue_patch import Region, with_changes
from dsnet.markers.marker_files import is_lone, lone_files, marker_file
from dsnet.markers.registration import SOFT
from dsnet.pictures.page_templates import fill_template
from dsnet.prediction.load_model import TrainedModel, load_model

FITTED = "dsnet_plus_markers"
LABEL = "DSNet+, of skin markers"
_MOST_RECORDINGS = 4
"""Recordings of one subject that are fitted, the longest ones; more add little."""
_MOST_SHOWN = 20
_REMEDY = "Leave out the motion that has wild values."


@dataclass(frozen=True)
class _Subject:
    betas: tuple[float, ...]
    files: tuple[Path, ...]
    digests: tuple[str, ...]


@dataclass(frozen=True)
class _SubjectFit:
    """Fits of one subject's regions; a checkpoint, from which a training can resume."""

    estimates: dict[str, Estimate]
    refused: dict[str, str]
    """Reasons by file."""
    betas: list[float]
    """(10,) of the body that was fitted."""


def train_on_markers(run: Run, folder: Path) -> None:
    """Fit `dsnet_plus`, the run's or the packaged one, to the subjects of a folder."""
    of_run = load_model(run, NAME) if run.finished(TRAIN_PLUS) else None
    gender, subjects, refused = subjects_of(folder, of_run and of_run.body.gender)
    base = of_run or load_model(None, NAME, gender)
    motions = sum(len(subject.files) for subject in subjects)
    notify(f"{folder}: {len(subjects)} people ({gender}), {motions} motions")
    run.build(
        TRAIN_MARKERS,
        {"people": [subject.digests for subject in subjects]},
        lambda writer: _make(writer, base, gender, subjects, refused),
        data="licensed",
        upstream=base.artifacts if of_run else {"packaged": base.artifacts[TRAIN_PLUS]},
    )


def subjects_of(folder: Path, gender: str | None) -> tuple[str, list[_Subject], dict[str, str]]:
    """Find the subjects of a folder whose motions have markers, all of one gender.

    Motions with other betas are taken as another subject's, recordings without poses as those of
    one subject a folder. What files' readers say of them is told.

    Parameters
    ----------
    gender : of the subjects; None for the gender of most subjects.

    Returns
    -------
    The gender, its subjects, and the reason why each other file is left out.

    Raises
    ------
    DsnetError
        If the folder does not exist or has no such motion.
    """
    if not folder.is_dir():
        raise DsnetError(f"--markers {folder}", "a folder of motions with markers", "Check it.")
    files_of: dict[tuple[str, tuple[float, ...], str], dict[str, Path]] = {}
    notes: list[str] = []
    refused: dict[str, str] = {}
    digests: set[str] = set()
    files = sorted({*files_below(folder), *lone_files(folder)})
    for path in progress(files, what="looking", unit="file"):
        try:
            if (markers := marker_file(path)) is None:
                refused[str(path)] = "no markers"
            elif (digest := sha256_of(markers)) in digests:
                refused[str(path)] = "the same recording again"
            else:
                subject = _subject_of(path, notes)
                files_of.setdefault(subject, {})[digest] = markers
                digests.add(digest)
        except DsnetError as error:
            refused[str(path)] = _reason(path, error)
    for line in notes[:_MOST_SHOWN]:
        notify(line)
    if len(notes) > _MOST_SHOWN:
        notify(f"{len(notes)} such notes in all")
    counts = Counter(gender_of_file for gender_of_file, *_ in files_of)
    chosen = gender or max(("female", "male"), key=lambda one: counts[one])
    other = {"female": "male", "male": "female"}.get(chosen, "")
    refused |= {
        str(file): f"of a {other} body"
        for (gender_of_file, *_), files in files_of.items()
        if gender_of_file == other
        for file in files.values()
    }
    subjects = [
        _Subject(betas, tuple(files.values()), tuple(files))
        for (gender_of_file, betas, _), files in files_of.items()
        if gender_of_file != other
    ]
    if not subjects:
        why = _counted(refused.values()) or "no motion"
        raise DsnetError(
            f"--markers {folder}, with {why}",
            f"motions of {chosen} bodies with skin markers",
            "AMASS's SMPL-H release has marker_data; so C3D, TRC, TSV, CSV of laboratories.",
        )
    return chosen, subjects, refused


def _subject_of(path: Path, notes: list[str]) -> tuple[str, tuple[float, ...], str]:
    """Gender, betas, and where nobody says these, the folder: recordings of one folder without
    poses are one person's. Adds what the file's reader says of it to the notes."""
    if is_lone(path):
        return "unknown", (0.0,) * N_BETAS, str(path.parent)
    motion = read_motion_file(path)
    notes += motion.notes
    return motion.gender, tuple(motion.betas.round(4).tolist()), ""


def _make(
    writer: ArtifactWriter,
    base: TrainedModel,
    gender: str,
    subjects: Sequence[_Subject],
    refused: Mapping[str, str],
) -> None:
    body, model = base.body, TrainedPlus.load(base.artifacts[TRAIN_PLUS])
    items = [(one, writer.checkpoints / f"{json_sha256(one.digests)}.json") for one in subjects]
    with worker_pool("processes", (body, model)) as pool:
        done = pool.map(_fit_or_resume, items)
        fits = [*progress(done, what="fitting", unit="person", total=len(subjects))]
    refused = {**refused, **{file: why for one in fits for file, why in one.refused.items()}}
    for file, why in [*refused.items()][:_MOST_SHOWN]:
        notify(f"left out: {file}: {why}")
    if len(refused) > _MOST_SHOWN:
        notify(f"left out: {len(refused)} files in all")
    rows_of = {part: [k for k, one in enumerate(fits) if part in one.estimates] for part in SOFT}
    fitted = {
        part: combine(part, [fits[k].estimates[part] for k in rows])
        for part, rows in rows_of.items()
        if rows
    }
    if not any(one.told for one in fitted.values()):
        raise DsnetError(
            f"markers of {len(subjects)} people that say nothing of their soft tissue "
            f"({_counted(refused.values()) or 'too little motion'})",
            "people who run, jump or dance, with LBUST, MBLLY, LBUM, LTHI or the like",
            "Pass other motions.",
        )
    trained = _model(body, model, fits, fitted, rows_of)
    refuse_nonfinite(trained.arrays(), FITTED, _REMEDY)
    save_weights(writer.file_path(f"{NAME}.safetensors"), trained.arrays())
    table = fill_template("fitted.md.j2", parts=SOFT, fitted=fitted)
    writer.file_path("markers.md").write_text(table, encoding="utf-8")
    for line in table.splitlines():
        notify(line)
    writer.record(
        predictors={FITTED: {"label": LABEL, "departures": ["constants of people's skin markers"]}},
        default=FITTED,
        gender=gender if base.owner.startswith("the packaged") else None,
        regions={part: asdict(one) for part, one in fitted.items()},
        people=len(subjects),
        left_out=len(refused),
        base=str(base.origin),
    )


def _fit_or_resume(
    tools: tuple[BodyModelData, TrainedPlus], item: tuple[_Subject, Path]
) -> _SubjectFit:
    """Fit one subject, or read the fit from a checkpoint."""
    (body, model), (subject, checkpoint) = tools, item
    if checkpoint.is_file():
        stored = json.loads(checkpoint.read_text(encoding="utf-8"))
        estimates = {part: Estimate(**one) for part, one in stored["estimates"].items()}
        return _SubjectFit(estimates, stored["refused"], stored.get("betas", [*subject.betas]))
    recordings: list[Recording] = []
    refused = {}
    for file in subject.files:
        try:
            recordings.append(read_recording(file, body))
        except DsnetError as error:
            refused[str(file)] = _reason(file, error)
    recordings = sorted(recordings, key=lambda one: -len(one.motion.theta))[:_MOST_RECORDINGS]
    betas = recordings[0].motion.betas.tolist() if recordings else [*subject.betas]
    estimates = fit_subject(body, model, recordings) if recordings else {}
    fit = _SubjectFit(estimates, refused, betas)
    write_text_atomically(checkpoint, json.dumps(asdict(fit)))
    return fit


def _model(
    body: BodyModelData,
    model: TrainedPlus,
    fits: Sequence[_SubjectFit],
    fitted: Mapping[str, RegionFit],
    rows_of: Mapping[str, list[int]],
) -> TrainedPlus:
    """The base model with the population's constants, and the subjects as training subjects.

    Each subject's residual has its own frequency.
    """
    regions = {part: Region.of(body, model, part) for part in fitted}
    measured = {part: one for part, one in fitted.items() if one.told}
    betas = np.array([fit.betas for fit in fits], np.float32)
    shares = np.stack([shares_of_people(one, model.people_betas) for one in betas])
    residual = np.tensordot(shares, model.weights.residual, 1)
    for part, one in measured.items():
        for row, change in zip(rows_of[part], one.own, strict=True):
            residual[row, :, 0] += regions[part].softness * (change[0] - one.change[0])
    changes = {part: one.change for part, one in measured.items()}
    changed = with_changes(body, model, regions, changes)
    constant_m = model.static.constant_m
    if constant_m.size:
        none = np.zeros((len(fits), *constant_m.shape[1:]), np.float32)
        constant_m = np.concatenate([constant_m, none])
    return replace(
        changed,
        weights=replace(changed.weights, residual=_joined(model.weights.residual, residual)),
        static=replace(model.static, constant_m=constant_m),
        people_betas=_joined(model.people_betas, betas),
    )


def _joined(first: NDArray, second: NDArray) -> NDArray[np.float32]:
    return np.concatenate([first, second]).astype(np.float32)


def _reason(file: Path, error: DsnetError) -> str:
    return error.received.removeprefix(f"{file}, ")


def _counted(reasons: Iterable[str]) -> str:
    """The most frequent reasons with their counts."""
    return ", ".join(f"{count} {why}" for why, count in Counter(reasons).most_common(12))
