"""A trained predictor and the body that it moves: of a run, or the small one of the package.

The package's models (`python tools/build_packaged_models.py` makes them) are artifacts like a
stage's: `dsnet_plus` of the synthetic corpus, for the embedded body of one gender.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from bridge.body import BodyModelData, load_body_model
from bridge.body.embedded import EMBEDDED_GENDERS, EMBEDDED_PREFIX, embedded_gender
from bridge.errors import DsnetError, did_you_mean, notify, unknown_name
from bridge.exchange.dsnet import load_trained_dsnet
from bridge.paper import N_BETAS
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.artifact import DataOrigin, DataShown
from bridge.runs.run import TRAIN_MARKERS, TRAIN_PLUS, body_model_path
from bridge.runs.untrusted import damage_refused
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.models import DsnetModel, Model, PlusModel
from dsnet.prediction.transfer_cache import body_digest, carried_over

PACKAGED = "packaged-model"
"""Kind of the package's artifacts."""


def _open_plus(trained: TrainedModel, body: BodyModelData) -> Model:
    (artifact,) = trained.artifacts.values()
    plus = TrainedPlus.load(artifact)
    if body is trained.other_body or body is not trained.own_body:
        made_of = f"{trained.trained_on} {artifact.content_sha256}"
        plus = carried_over(plus, made_of, lambda: trained.own_body, body)
    return PlusModel(plus, body)


def _open_dsnet(trained: TrainedModel, body: BodyModelData) -> Model:
    if body is not trained.own_body and body_digest(body) != body_digest(trained.own_body):
        raise DsnetError(
            f"{trained.name} of {trained.owner} with the body {body.name}",
            "the body that it was trained on: the paper's networks know its vertices by number",
            "Leave --body and DSNET_BODY out, or take dsnet_plus, which moves any body.",
        )
    artifacts = trained.artifacts
    network = load_trained_dsnet(artifacts["train"], trained.name)
    return DsnetModel(network, artifacts["train-ae"], body)


PIPELINES: dict[tuple[str, ...], Callable[[TrainedModel, BodyModelData], Model]] = {
    (TRAIN_MARKERS,): _open_plus,
    (TRAIN_PLUS,): _open_plus,
    ("train", "train-ae"): _open_dsnet,
}
"""Stages of a run that together predict motions, the best first: `dsnet_plus` with constants of
people's skin markers, `dsnet_plus`, and the paper's DSNet. The manifest of the first stage names
the predictors and a default; the function opens one on a body, `DsnetError` if it cannot move that.
"""


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """The predictor that was asked for, or that there is to offer; loaded when it is used."""

    name: str
    label: str
    """As in tables and legends."""
    why: str
    """Why this one."""
    owner: str
    """Whose it is, as in "run 'demo'"."""
    body_model: str
    """Of the body that it moves: `embedded:female`, or the path of an SMPL model file."""
    trained_on: str
    """The same of the body that it was trained on."""
    artifacts: Mapping[str, Artifact]
    """What it is made of, by stage, in the order of its pipeline."""
    other_body: BodyModelData | None = None
    """That it moves, if not the one that it was trained on."""

    @property
    def origin(self) -> DataOrigin:
        """Of what it was trained on."""
        return next(iter(self.artifacts.values())).origin

    @property
    def shows(self) -> DataShown:
        """What data its pictures and files show."""
        is_licensed = self.origin == "synthetic" and self.body.source == "licensed"
        return "synthetic flesh" if is_licensed else self.origin

    @property
    def upstream(self) -> dict[str, str]:
        """Digests of all that it is made of, by stage."""
        return {stage: artifact.content_sha256 for stage, artifact in self.artifacts.items()}

    @property
    def body(self) -> BodyModelData:
        """That it moves."""
        return self.other_body or self.own_body

    @cached_property
    def own_body(self) -> BodyModelData:
        """That it was trained on."""
        return load_body_model(self.trained_on)

    @cached_property
    def model(self) -> Model:
        return self.open(self.body)

    def on(self, body: BodyModelData, body_model: str) -> TrainedModel:
        """The same, to move another body."""
        if body_model == self.trained_on:
            return self
        why = f"{self.why}, on {body.name}"
        return replace(self, body_model=body_model, other_body=body, why=why)

    def open(self, body: BodyModelData) -> Model:
        """The model on a body; DsnetError if what its training left does not fit together."""

        # Arrays of a stranger's can be missing, of other shapes or types, or none of a network.
        def refusal(error: Exception) -> DsnetError:
            return DsnetError(
                f"{self.name} of {self.owner}, whose arrays do not fit together ({error!s:.200})",
                "what its training wrote",
                "Train it again, or copy the run again.",
            )

        with damage_refused(refusal):
            return PIPELINES[tuple(self.artifacts)](self, body)


def body_asked(given: Path | str | None) -> str | None:
    """The body model of `--body`, else of `DSNET_BODY`, which stands for always; None for the one
    that a predictor was trained on."""
    return str(given or os.environ.get("DSNET_BODY") or "") or None


def load_model(
    run: Run | None,
    predictor: str | None = None,
    gender: str = "unknown",
    body: str | None = None,
    kind: str | None = None,
    more_betas: int = 0,
) -> TrainedModel:
    """A predictor of a run, the best there is if none is named; without a run, the package's for a
    body of `gender`, `female` where it is neither. DsnetError if there is no such predictor, what
    it is made of is no chain, or a file is damaged.

    `body` is the model file of another body than it was trained on, or a folder, from which one of
    the gender and `kind` is taken (`bridge.motion.Motion`); with `more_betas` than ten if it has.
    """
    if body is None:
        found = find_model(run, predictor, gender)
    else:
        moved = load_body_model(body, gender, kind)
        known = (one for one in (moved.gender, gender) if one in EMBEDDED_GENDERS)
        shapes = N_BETAS + min(more_betas, max(moved.shapedirs.shape[-1] - N_BETAS, 0))
        found = find_model(run, predictor, next(known, "unknown"))
        found = found.on(moved.with_shapes(shapes), body)
        for note in moved.notes:
            notify(note)
    _ = found.model
    return found


def packaged_folder(gender: str) -> Path:
    """Where the model of `female` or `male` bodies lies."""
    return Path(str(resources.files("dsnet.prediction"))) / "packaged" / gender


def find_model(run: Run | None, asked: str | None = None, gender: str = "unknown") -> TrainedModel:
    """As `load_model`, on the body that it was trained on; nothing is read yet but manifests."""
    if run is None:
        taken, line = embedded_gender(gender)
        if line:
            notify(line)
        return _packaged(asked, taken)
    trained = {
        stages: read_artifact(run.path / stages[0]).manifest
        for stages in PIPELINES
        if run.finished(stages[0])
    }
    train = f"`dsnet train --run {run.name}`"
    if not trained:
        if not run.path.is_dir():
            run.artifact(TRAIN_PLUS)  # says which runs there are
        finished = " or ".join(f"a finished stage {first!r}" for first, *_ in [*PIPELINES][1:])
        raise DsnetError(f"run {run.name!r} without a trained predictor", finished, f"Run {train}.")
    for stages, manifest in trained.items():
        name = asked or str(manifest["default"])
        if name in manifest["predictors"]:
            entry = manifest["predictors"][name]
            return TrainedModel(
                name,
                label=str(entry.get("label", name)) if isinstance(entry, dict) else name,
                why="the run's best" if asked is None else "as asked",
                owner=f"run {run.name!r}",
                body_model=_body_of(run, manifest),
                trained_on=_body_of(run, manifest),
                artifacts=run.artifacts(*stages),
            )
    there = [name for manifest in trained.values() for name in manifest["predictors"]]
    received = f"predictor {asked!r} asked of run {run.name!r}"
    remedy = f"Name one of these, or train another: {train}."
    raise unknown_name(received, asked or "", there, remedy)


def _body_of(run: Run, manifest: Mapping[str, Any]) -> str:
    """The body that a run's predictor moves: the package's where it began with its model."""
    gender = manifest.get("gender")
    return EMBEDDED_PREFIX + gender if gender in EMBEDDED_GENDERS else str(body_model_path(run))


def _packaged(asked: str | None, gender: str) -> TrainedModel:
    artifact = read_artifact(packaged_folder(gender), PACKAGED)
    (name, entry), *_ = artifact.manifest["predictors"].items()
    if asked not in (None, name):
        otherwise = "Train another and name its run: ./reproduce.sh, then --run demo."
        raise DsnetError(
            f"predictor {asked!r} without a run",
            f"{name}, which comes with the package",
            did_you_mean(asked or "", [name], otherwise),
        )
    return TrainedModel(
        name,
        label=entry["label"],
        why="no --run given",
        owner=f"the packaged model ({gender}, {artifact.origin})",
        body_model=EMBEDDED_PREFIX + gender,
        trained_on=EMBEDDED_PREFIX + gender,
        artifacts={TRAIN_PLUS: artifact},
    )
