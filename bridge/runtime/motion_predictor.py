"""Which predictor of a run moves its body, whatever kind it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bridge.body import BodyModelData
from bridge.errors import DsnetError, did_you_mean
from bridge.runs import Artifact, Run, read_artifact
from bridge.runs.run import body_model_path
from bridge.runs.untrusted import damage_refused
from bridge.runtime.stepping import Model

Open = Callable[[Mapping[str, Artifact], str, BodyModelData], Model]
"""A predictor from its road's artifacts by stage, its name, and the body that it moves."""


@dataclass(frozen=True)
class MotionRoad:
    """Some stages of a run that together predict motions."""

    stages: tuple[str, ...]
    """Whose artifacts are needed; the manifest of the first names the predictors and a default."""
    command: str
    """What trains them."""
    open: Open


@dataclass(frozen=True, eq=False)
class Chosen:
    """The predictor that was asked for, or that the run has to offer."""

    name: str
    label: str
    """As in tables and legends."""
    why: str
    """Why this one."""
    owner: str
    """Whose it is, as in "run 'demo'"."""
    body_model: str
    """Of the body that it moves: `embedded:female`, or the path of an SMPL model file."""
    artifacts: Mapping[str, Artifact]
    """What it is made of, by stage."""
    road: MotionRoad

    @property
    def trained(self) -> Artifact:
        """What its training made."""
        return self.artifacts[self.road.stages[0]]

    @property
    def upstream(self) -> dict[str, str]:
        """Digests of all that it is made of, by stage."""
        return {stage: artifact.content_sha256 for stage, artifact in self.artifacts.items()}

    def open(self, body: BodyModelData) -> Model:
        """Load it.

        Raises
        ------
        DsnetError
            If what its training left does not fit together.
        """

        # Arrays of a stranger's can be missing, of other shapes or types, or none of a network.
        def refusal(error: Exception) -> DsnetError:
            return DsnetError(
                f"{self.name} of {self.owner}, whose arrays do not fit together ({error!s:.200})",
                "what its training wrote",
                "Train it again, or copy the run again.",
            )

        with damage_refused(refusal):
            return self.road.open(self.artifacts, self.name, body)


def choose_predictor(run: Run, asked: str | None, roads: tuple[MotionRoad, ...]) -> Chosen:
    """The predictor named `asked`; when None, the default of the first road that the run has.

    Raises
    ------
    DsnetError
        If the run has none of that name or none at all, or its stages are no chain.
    """
    trained = {road: _manifest(run, road) for road in roads if run.finished(road.stages[0])}
    if not trained:
        raise _nothing_trained(run, roads)
    for road, manifest in trained.items():
        name = asked or str(manifest["default"])
        if name in manifest["predictors"]:
            entry = manifest["predictors"][name]
            label = str(entry.get("label", name)) if isinstance(entry, dict) else name
            why = "the run's best" if asked is None else "as asked"
            artifacts, body_model = run.artifacts(*road.stages), str(body_model_path(run))
            return Chosen(name, label, why, f"run {run.name!r}", body_model, artifacts, road)
    there = [name for manifest in trained.values() for name in manifest["predictors"]]
    otherwise = f"Name one of these, or train another: {_commands(run, roads)}."
    raise DsnetError(
        f"predictor {asked!r} asked of run {run.name!r}",
        f"one of {', '.join(there)}",
        did_you_mean(asked or "", there, otherwise),
    )


def _manifest(run: Run, road: MotionRoad) -> dict:
    return read_artifact(run.path / road.stages[0]).manifest


def _nothing_trained(run: Run, roads: tuple[MotionRoad, ...]) -> DsnetError:
    if not run.path.is_dir():
        run.artifact(roads[0].stages[0])  # says which runs there are
    return DsnetError(
        f"run {run.name!r} without a trained predictor",
        " or ".join(f"a finished stage {road.stages[0]!r}" for road in roads),
        f"Run {_commands(run, roads)}.",
    )


def _commands(run: Run, roads: tuple[MotionRoad, ...]) -> str:
    commands = (f"`dsnet {road.command} --run {run.name}`" for road in roads)
    return " or ".join(dict.fromkeys(commands))
