"""`dsnet train --markers`: a model of flesh whose constants real people's skin markers say."""

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
from bridge.runs import ArtifactWriter, Run
from bridge.runs.files import json_sha256, sha256_of, write_text_atomically
from bridge.runs.run import TRAIN_MARKERS, TRAIN_PLUS
from bridge.runs.workers import progress, worker_pool
from bridge.tissue.trained_plus import NAME, TrainedPlus, shares_of_people
from dsnet.fitting.evidence import Take, read_take
from dsnet.fitting.fit import Estimate, fit_person
from dsnet.fitting.flesh_patch import Region, with_changes
from dsnet.fitting.population import Fitted, share
from dsnet.markers.marker_files import marker_file
from dsnet.markers.registration import SOFT
from dsnet.prediction.load_model import TrainedModel, load_model
from dsnet.report.pages import render

FITTED = "dsnet_plus_markers"
LABEL = "DSNet+, of skin markers"
_MOST_TAKES = 4
"""Of a person: those that last longest, as more say the same again."""
_MOST_SHOWN = 20
_REMEDY = "Leave the motion out that is wild."


@dataclass(frozen=True)
class _Person:
    betas: tuple[float, ...]
    files: tuple[Path, ...]
    digests: tuple[str, ...]


@dataclass(frozen=True)
class _Told:
    """Of one person, as it is kept for a training that goes on."""

    estimates: dict[str, Estimate]
    refused: dict[str, str]
    """Why, by the names of files."""
    betas: list[float]
    """(10,) of the body that was fitted."""


def train_on_markers(run: Run, folder: Path) -> None:
    """Fit `dsnet_plus`, the run's or the package's, to the people of a folder."""
    own = load_model(run, NAME) if run.finished(TRAIN_PLUS) else None
    gender, people, refused = people_of(folder, own and own.body.gender)
    base = own or load_model(None, NAME, gender)
    notify(
        f"{folder}: {len(people)} people ({gender}), {sum(len(p.files) for p in people)} motions"
    )
    run.build(
        TRAIN_MARKERS,
        {"people": [person.digests for person in people]},
        lambda writer: _make(writer, base, gender, people, refused),
        data="licensed",
        upstream=base.artifacts if own else {"packaged": base.artifacts[TRAIN_PLUS]},
    )


def people_of(folder: Path, gender: str | None) -> tuple[str, list[_Person], dict[str, str]]:
    """The people of a gender whose motions have markers, and why other files are left out.

    Without a gender, that of most people. Who has another shape is another person.
    """
    if not folder.is_dir():
        raise DsnetError(f"--markers {folder}", "a folder of motions with markers", "Check it.")
    found: dict[tuple[str, tuple[float, ...]], dict[str, Path]] = {}
    refused: dict[str, str] = {}
    digests: set[str] = set()
    for path in progress(files_below(folder), what="looking", unit="file"):
        try:
            if (markers := marker_file(path)) is None:
                refused[str(path)] = "no markers"
            elif (digest := sha256_of(markers)) in digests:
                refused[str(path)] = "the same recording again"
            else:
                motion = read_motion_file(path)
                who = motion.gender, tuple(motion.betas.round(4).tolist())
                found.setdefault(who, {})[digest] = markers
                digests.add(digest)
        except DsnetError as error:
            refused[str(path)] = _why(path, error)
    counts = Counter(stated for stated, _ in found)
    chosen = gender or max(("female", "male"), key=lambda one: counts[one])
    other = {"female": "male", "male": "female"}.get(chosen, "")
    refused |= {
        str(f): f"of a {other} body"
        for (g, _), fs in found.items()
        if g == other
        for f in fs.values()
    }
    people = [
        _Person(betas, tuple(files.values()), tuple(files))
        for (stated, betas), files in found.items()
        if stated != other
    ]
    if not people:
        why = _counted(refused.values()) or "no motion"
        raise DsnetError(
            f"--markers {folder}, with {why}",
            f"motions of {chosen} bodies with skin markers",
            "AMASS's SMPL-H release has marker_data; a C3D lies beside its pose.",
        )
    return chosen, people, refused


def _make(
    writer: ArtifactWriter,
    base: TrainedModel,
    gender: str,
    people: Sequence[_Person],
    refused: Mapping[str, str],
) -> None:
    body, model = base.body, TrainedPlus.load(base.artifacts[TRAIN_PLUS])
    kept = [(one, writer.checkpoints / f"{json_sha256(one.digests)}.json") for one in people]
    with worker_pool("processes", (body, model)) as pool:
        fits = pool.map(_tell, kept)
        told = [*progress(fits, what="fitting", unit="person", total=len(people))]
    refused = {**refused, **{file: why for one in told for file, why in one.refused.items()}}
    for file, why in [*refused.items()][:_MOST_SHOWN]:
        notify(f"left out: {file}: {why}")
    if len(refused) > _MOST_SHOWN:
        notify(f"left out: {len(refused)} files in all")
    who = {part: [k for k, one in enumerate(told) if part in one.estimates] for part in SOFT}
    fitted = {
        part: share(part, [told[k].estimates[part] for k in rows])
        for part, rows in who.items()
        if rows
    }
    if not any(one.told for one in fitted.values()):
        raise DsnetError(
            f"markers of {len(people)} people that say nothing of their flesh "
            f"({_counted(refused.values()) or 'too little motion'})",
            "people who run, jump or dance, with LBUST, MBLLY, LBUM, LTHI or the like",
            "Pass other motions.",
        )
    trained = _model(body, model, told, fitted, who)
    refuse_nonfinite(trained.arrays(), FITTED, _REMEDY)
    save_weights(writer.file_path(f"{NAME}.safetensors"), trained.arrays())
    table = render("fitted.md.j2", parts=SOFT, fitted=fitted)
    writer.file_path("markers.md").write_text(table, encoding="utf-8")
    for line in table.splitlines():
        notify(line)
    writer.record(
        predictors={FITTED: {"label": LABEL, "departures": ["constants of people's skin markers"]}},
        default=FITTED,
        gender=gender if base.owner.startswith("the packaged") else None,
        regions={part: asdict(one) for part, one in fitted.items()},
        people=len(people),
        left_out=len(refused),
        base=str(base.origin),
    )


def _tell(tools: tuple[BodyModelData, TrainedPlus], item: tuple[_Person, Path]) -> _Told:
    """One person's estimates; those of an earlier turn are taken."""
    (body, model), (person, kept) = tools, item
    if kept.is_file():
        stored = json.loads(kept.read_text(encoding="utf-8"))
        estimates = {part: Estimate(**one) for part, one in stored["estimates"].items()}
        return _Told(estimates, stored["refused"], stored.get("betas", [*person.betas]))
    takes: list[Take] = []
    refused = {}
    for file in person.files:
        try:
            takes.append(read_take(file, body))
        except DsnetError as error:
            refused[str(file)] = _why(file, error)
    takes = sorted(takes, key=lambda take: -len(take.motion.theta))[:_MOST_TAKES]
    betas = takes[0].motion.betas.tolist() if takes else [*person.betas]
    told = _Told(fit_person(body, model, takes) if takes else {}, refused, betas)
    write_text_atomically(kept, json.dumps(asdict(told)))
    return told


def _model(
    body: BodyModelData,
    model: TrainedPlus,
    people: Sequence[_Told],
    fitted: Mapping[str, Fitted],
    who: Mapping[str, list[int]],
) -> TrainedPlus:
    """What people share in the constants; each one's own frequency as that of a known person."""
    regions = {part: Region.of(body, model, part) for part in fitted}
    told = {part: one for part, one in fitted.items() if one.told}
    betas = np.array([person.betas for person in people], np.float32)
    known = np.stack([shares_of_people(one, model.people_betas) for one in betas])
    residual = np.tensordot(known, model.weights.residual, 1)
    for part, one in told.items():
        for row, own in zip(who[part], one.own, strict=True):
            residual[row, :, 0] += regions[part].shares * (own[0] - one.change[0])
    changed = with_changes(body, model, regions, {part: one.change for part, one in told.items()})
    constant_m = model.static.constant_m
    if constant_m.size:
        none = np.zeros((len(people), *constant_m.shape[1:]), np.float32)
        constant_m = np.concatenate([constant_m, none])
    return replace(
        changed,
        weights=replace(changed.weights, residual=_joined(model.weights.residual, residual)),
        static=replace(model.static, constant_m=constant_m),
        people_betas=_joined(model.people_betas, betas),
    )


def _joined(first: NDArray, second: NDArray) -> NDArray[np.float32]:
    return np.concatenate([first, second]).astype(np.float32)


def _why(file: Path, error: DsnetError) -> str:
    return error.received.removeprefix(f"{file}, ")


def _counted(reasons: Iterable[str]) -> str:
    return ", ".join(f"{count} {why}" for why, count in Counter(reasons).most_common(12))
