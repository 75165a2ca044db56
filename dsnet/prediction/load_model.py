"""A trained predictor and the body that it moves: of a run, a folder, or the package's small one.

A folder that `TrainedModel.save` wrote is an artifact like a stage's: `manifest.json`, the
configuration, and weights as safetensors. The package's models are such folders (`python
tools/build_packaged_models.py` makes them): `dsnet_plus` of the synthetic corpus, for the embedded
body of one gender.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from bridge.body import BodyModelData, load_body_model
from bridge.body.embedded import (
    EMBEDDED,
    EMBEDDED_GENDERS,
    EMBEDDED_PREFIX,
    embedded_gender,
)
from bridge.errors import DsnetError, did_you_mean, notify, unknown_name
from bridge.exchange.dsnet import load_trained_dsnet
from bridge.paper import N_BETAS
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.artifact import DataOrigin, DataShown
from bridge.runs.files import MANIFEST, runs_root
from bridge.runs.run import TRAIN_MARKERS, TRAIN_PLUS, body_model_path
from bridge.runs.untrusted import damage_refused
from bridge.tissue.trained_plus import NAME as PLUS
from bridge.tissue.trained_plus import TrainedPlus
from dsnet.prediction.models import DsnetModel, Model, PlusModel
from dsnet.prediction.out_folder import open_out_folder
from dsnet.prediction.runtimes import Runtime, keras_latents
from dsnet.prediction.transfer_cache import body_digest, carried_over

PACKAGED = "packaged-model"
"""Kind of an artifact that holds a model to predict with."""
NO_RUN = "no --run given"
"""Why the packaged model moves its own body."""
_CODEC = "autoencoder.safetensors"


def _open_plus(trained: TrainedModel, body: BodyModelData) -> Model:
    if trained.runtime != "onnx":
        raise DsnetError(
            f"--runtime {trained.runtime} with {trained.name} of {trained.owner}",
            "a network that Keras trained",
            "Leave --runtime out, or pass --run and a --predictor such as dsnet_standardised.",
        )
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
    by_keras = trained.runtime == "keras"
    latents_of = keras_latents(artifacts["train"], trained.name, body) if by_keras else None
    return DsnetModel(network, artifacts["train-ae"], body, latents_of)


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
    """The requested predictor, or the best there is; loaded when it is used."""

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
    runtime: Runtime = "onnx"
    """What predicts the latents of whole motions."""

    def save(self, folder: Path | str) -> Artifact:
        """Write what was trained as a folder, to be given away: `load_model(folder)` opens it.

        `manifest.json` and safetensors: 2 MB of `dsnet_plus`, 135 MB of the paper's networks. An
        embedded body is named in it; of a licensed one it holds the digest alone, and who opens the
        folder passes the file. DsnetError if the folder holds anything else.
        """
        first = next(iter(self.artifacts.values())).manifest
        wanted = {*(f"{n}.safetensors" for n in (PLUS, self.name)), f"{self.name}.keras", _CODEC}
        with open_out_folder(Path(folder), self.origin, PACKAGED) as writer:
            for artifact in self.artifacts.values():
                for name in sorted(wanted & artifact.manifest["files"].keys()):
                    shutil.copyfile(artifact.file(name), writer.file_path(name))
                if "architecture" in artifact.manifest:
                    writer.record(architecture=artifact.manifest["architecture"])
            is_embedded = self.trained_on.startswith(EMBEDDED_PREFIX)
            writer.record(
                predictors={self.name: first["predictors"][self.name]},
                default=self.name,
                stages=[*self.artifacts],
                body_model=self.trained_on if is_embedded else None,
                body_sha256=body_digest(self.own_body),
                gender=self.own_body.gender,
            )
            return writer.finish(config={}, upstream=self.upstream)

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

    def __getstate__(self) -> dict[str, Any]:
        """Fields alone: another process opens the model itself, as no session can be sent."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def on(self, body: BodyModelData, body_model: str) -> TrainedModel:
        """The same, to move another body."""
        if body_model == self.trained_on:
            own = self.other_body is None
            return self if own else replace(self, body_model=body_model, other_body=None)
        why = f"{self.why}, on {body.name}"
        return replace(self, body_model=body_model, other_body=body, why=why)

    def open(self, body: BodyModelData) -> Model:
        """The model on a body; DsnetError if what its training left does not fit together."""

        # Arrays in the file can be missing, of other shapes or types, or none of a network.
        def refusal(error: Exception) -> DsnetError:
            return DsnetError(
                f"{self.name} of {self.owner}, whose arrays do not fit together ({error!s:.200})",
                "what its training wrote",
                "Train it again, or copy the run again.",
            )

        with damage_refused(refusal):
            return PIPELINES[tuple(self.artifacts)](self, body)


def requested_body(given: Path | str | None) -> str | None:
    """The body model of `--body`, else of `DSNET_BODY`, which stands for always; None for the one
    that a predictor was trained on."""
    return str(given or os.environ.get("DSNET_BODY") or "") or None


Source: TypeAlias = TrainedModel | Run | os.PathLike[str] | str | None
"""Whose model: the package's (None, `female` or `male`), a run's or that of a run's name, that of a
folder which `TrainedModel.save` wrote, or one that is loaded."""


def is_on(body_model: str, asked: Path | str) -> bool:
    """Whether a body model is what `--body` asked for."""
    is_embedded = body_model.startswith(EMBEDDED_PREFIX)
    return body_model == str(asked) or (is_embedded and str(asked) == EMBEDDED)


def name_of(source: Source) -> str | None:
    """What a manifest says of where a model was from; None for the package's choice."""
    if isinstance(source, TrainedModel):
        return source.owner
    if isinstance(source, Run):
        return source.name
    return None if source is None else os.fspath(source)


def load_model(
    source: Source = None,
    predictor: str | None = None,
    gender: str = "unknown",
    body: str | os.PathLike[str] | None = None,
    kind: str | None = None,
    more_betas: int = 0,
    runtime: Runtime = "onnx",
) -> TrainedModel:
    """A predictor to move bodies with, on the body that it was trained on or on another.

    Parameters
    ----------
    source : None or `"female"`, `"male"`: the small model that comes with the package. A run's
        name: what it has trained. A folder that `TrainedModel.save` wrote.
    predictor : which of the run's; the run's best when None.
    gender : of the packaged model, where `source` does not say; `female` where it is neither.
    body : another body than it was trained on: an SMPL, SMPL-H or SMPL-X model file, or a folder of
        them, from which one of the gender and `kind` is taken (`bridge.motion.Motion`); or
        `embedded`: the embedded one that it was trained on, else that of the gender.
    more_betas : shape coefficients after the tenth that the body shall take, if it has them.
    runtime : what predicts the latents of whole motions; streams and exports are ONNX Runtime's.

    Raises
    ------
    DsnetError
        If there is no such predictor, what it is made of is no chain, or a file is damaged.
    """
    if body is not None and os.fspath(body) == EMBEDDED:
        own = find_model(source, predictor, gender).trained_on
        is_own = own.startswith(EMBEDDED_PREFIX)
        body = own if is_own else EMBEDDED_PREFIX + embedded_gender(gender)[0]
    moved = None if body is None else load_body_model(os.fspath(body), gender, kind)
    if moved is not None:
        genders = (one for one in (moved.gender, gender) if one in EMBEDDED_GENDERS)
        gender = next(genders, "unknown")
    trained = find_model(source, predictor, gender)
    if trained.runtime != runtime and not isinstance(source, TrainedModel):
        trained = replace(trained, runtime=runtime)
    if not trained.trained_on:
        trained = _on_licensed(trained, moved, str(body))
    elif moved is not None:
        shapes = N_BETAS + min(more_betas, max(moved.shapedirs.shape[-1] - N_BETAS, 0))
        trained = trained.on(moved.with_shapes(shapes), str(body))
    for note in () if moved is None else moved.notes:
        notify(note)
    _ = trained.model
    return trained


def _on_licensed(trained: TrainedModel, body: BodyModelData | None, path: str) -> TrainedModel:
    """The model of a folder that could not hold the body that it was trained on: on that body."""
    (artifact, *_) = trained.artifacts.values()
    if body is None or body_digest(body) != artifact.manifest["body_sha256"]:
        raise DsnetError(
            f"{trained.owner} {'without a body' if body is None else f'with the body {body.name}'}",
            "the licensed body that it was trained on, which the folder cannot hold",
            "Pass the file of that body.",
        )
    return replace(trained, body_model=path, trained_on=path)


def packaged_folder(gender: str) -> Path:
    """Where the model of `female` or `male` bodies lies."""
    return Path(str(resources.files("dsnet.prediction"))) / "packaged" / gender


def find_model(
    source: Source, predictor: str | None = None, gender: str = "unknown"
) -> TrainedModel:
    """As `load_model`, on the body that it was trained on; nothing is read yet but manifests."""
    if isinstance(source, TrainedModel):
        _check_name(predictor, source.name, f"of {source.owner}", "Load the other one.")
        return source
    if source is None or source in EMBEDDED_GENDERS:
        taken, line = embedded_gender(str(source or gender))
        if line:
            notify(line)
        otherwise = "Train another and name its run: ./reproduce.sh, then --run demo."
        _check_name(predictor, PLUS, "without a run", otherwise)
        return _of_folder(packaged_folder(taken), NO_RUN, taken)
    if isinstance(source, Run):
        return _of_run(source, predictor)
    folder = Path(source)
    is_run = len(folder.parts) == 1 and (runs_root() / folder).is_dir()
    if (folder / MANIFEST).is_file() and not is_run:
        trained = _of_folder(folder, "the folder's")
        _check_name(predictor, trained.name, f"of {trained.owner}", "Leave the name out.")
        return trained
    if len(folder.parts) > 1:
        raise DsnetError(
            f"a model in {folder}, which holds none",
            "a run's name, or a folder that a model was saved to",
            "Check the path.",
        )
    return _of_run(Run(os.fspath(source)), predictor)


def _check_name(predictor: str | None, name: str, owner: str, otherwise: str) -> None:
    if predictor not in (None, name):
        received = f"predictor {predictor!r} {owner}"
        raise DsnetError(received, name, did_you_mean(predictor or "", [name], otherwise))


def _of_run(run: Run, predictor: str | None) -> TrainedModel:
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
        name = predictor or str(manifest["default"])
        if name in manifest["predictors"]:
            entry = manifest["predictors"][name]
            return TrainedModel(
                name,
                label=str(entry.get("label", name)) if isinstance(entry, dict) else name,
                why="the run's best" if predictor is None else "as requested",
                owner=f"run {run.name!r}",
                body_model=_body_of(run, manifest),
                trained_on=_body_of(run, manifest),
                artifacts=run.artifacts(*stages),
            )
    there = [name for manifest in trained.values() for name in manifest["predictors"]]
    received = f"predictor {predictor!r} of run {run.name!r}"
    remedy = f"Name one of these, or train another: {train}."
    raise unknown_name(received, predictor or "", there, remedy)


def _body_of(run: Run, manifest: Mapping[str, Any]) -> str:
    """The body that a run's predictor moves: the package's where it began with its model."""
    gender = manifest.get("gender")
    return EMBEDDED_PREFIX + gender if gender in EMBEDDED_GENDERS else str(body_model_path(run))


def _of_folder(folder: Path, why: str, packaged: str = "") -> TrainedModel:
    """The model that a folder holds; `packaged` is the gender of the package's."""
    artifact = read_artifact(folder, PACKAGED)
    manifest = artifact.manifest
    (name, entry), *_ = manifest["predictors"].items()
    stages = tuple(manifest.get("stages", (TRAIN_PLUS,)))
    if stages not in PIPELINES:
        raise DsnetError(
            f"{folder}, a model of stages {stages}", "stages of this version", "Save it again."
        )
    body_model = manifest.get("body_model", EMBEDDED_PREFIX + str(manifest.get("gender"))) or ""
    owner = f"the packaged model ({packaged}, {artifact.origin})" if packaged else str(folder)
    return TrainedModel(
        name,
        label=str(entry.get("label", name)),
        why=why,
        owner=owner,
        body_model=body_model,
        trained_on=body_model,
        artifacts=dict.fromkeys(stages, artifact),
    )
