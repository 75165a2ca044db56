"""A run: the folder `runs/<run>/`, one artifact a stage, each made at most once, in one chain."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError, did_you_mean
from bridge.runs.artifact import SCHEMA_VERSION, Artifact, DataOrigin, read_artifact
from bridge.runs.files import (
    MANIFEST,
    exclusive,
    is_finished,
    json_sha256,
    runs_root,
    sha256_of,
    stamp_of,
    tidy,
    work_folder,
)
from bridge.runs.writer import ArtifactWriter, is_begun

ALIGNMENT = "align"
# Beside the paper's aligner's, of the same meshes.
ROBUST_ALIGNMENT = "align_robust"
# Of networks, of dsnet_plus, of people's skin markers: what was trained; what it makes of the
# sequences.
TRAIN, TRAIN_PLUS, TRAIN_MARKERS = "train", "train_plus", "train_markers"
INFER, INFER_PLUS = "infer", "infer_plus"

# Artifacts that are not named after the command that makes them.
_MADE_BY = {"truth": "corpus", ROBUST_ALIGNMENT: ALIGNMENT, TRAIN_PLUS: TRAIN,
            TRAIN_MARKERS: TRAIN, INFER_PLUS: INFER}  # fmt: skip
STAGES = {
    *("corpus", "train-ae", "encode", "decode", "evaluate", "report", "verify"),
    *(ALIGNMENT, TRAIN, INFER, *_MADE_BY),
}
"""Names of the folders that commands make in a run."""


def command_of(stage: str) -> str:
    return _MADE_BY.get(stage, stage)


class Run:
    """One run's folder and the artifacts in it."""

    def __init__(self, name: str) -> None:
        if not name or name != Path(name).name or name.startswith("."):
            raise DsnetError(
                f"run name {name!r}", "a plain folder name such as 'demo'", "Pass --run NAME."
            )
        self.name = name
        self.path = runs_root() / name

    def finished(self, stage: str) -> bool:
        """Whether there is an artifact of `stage`, current or not.

        A folder that has lost its manifest is refused: damage, not a stage that was never made.
        """
        folder = self.path / stage
        if is_finished(folder) or not folder.exists():
            return is_finished(folder)
        if is_finished(folder):  # put into place between the two questions
            return True
        command = f"`dsnet {command_of(stage)} --run {self.name}`"
        raise DsnetError(
            f"{folder}, which has lost its {MANIFEST}",
            "the folder of a finished stage, or none",
            f"Run {command} again, with the options that it had.",
        )

    def refuse_interrupted(self, *stages: str) -> None:
        """Refuse to go on without a stage whose making was begun and not ended."""
        for stage in stages:
            if not self.finished(stage) and work_folder(self.path / stage).exists():
                raise self._without(stage)

    def artifact(self, stage: str) -> Artifact:
        """The finished artifact of `stage`; refused if something before it was made again since."""
        return self.artifacts(stage)[stage]

    def artifacts(self, *stages: str) -> dict[str, Artifact]:
        """The finished artifacts of several stages, by name; see `artifact`."""
        for stage in stages:
            if not self.finished(stage):
                raise self._without(stage)
        self.check_chain(stages)
        return {stage: read_artifact(self.path / stage) for stage in stages}

    def check_chain(self, stages: Iterable[str]) -> None:
        """Refuse stages that are older than what they, or those before, were made of.

        What was deleted since cannot be compared and is passed over. The refusal names the stages
        to run again, in order.
        """
        seen: dict[str, bool] = {}
        newer: list[str] = []

        def is_old(stage: str, *later: str) -> bool:
            if stage in later:
                raise DsnetError(
                    f"stage {stage!r} of {self.path}, which was made from itself",
                    "one chain",
                    "Delete its folder and run its stage again.",
                )
            if stage not in seen:
                artifact = read_artifact(self.path / stage)
                sources = artifact.manifest["upstream"]
                changed = [has_changed(artifact, source, stage, *later) for source in sources]
                seen[stage] = any(changed)  # each source was looked at, so that each is named
            return seen[stage]

        def has_changed(artifact: Artifact, source: str, *later: str) -> bool:
            present = recorded = artifact.manifest["upstream"][source]
            place = artifact.manifest["provenance"].get("inputs", {}).get(source)
            if place and (self.path / place).is_file():
                present = artifact.present_sha256(self.path / place, place, recorded)
            elif not place and self.finished(source):
                if is_old(source, *later):
                    return True
                present = read_artifact(self.path / source).content_sha256
            if present != recorded:
                newer.append(place or source)
            return present != recorded

        for stage in stages:
            is_old(stage)
        if not (old := [stage for stage, stage_is_old in seen.items() if stage_is_old]):
            return
        remade = ", ".join(map(repr, dict.fromkeys(newer)))
        those = f"stages {', '.join(old)} are" if len(old) > 1 else f"stage {old[0]} is"
        commands = (f"`dsnet {command_of(stage)} --run {self.name}`" for stage in old)
        raise DsnetError(
            f"run {self.name!r}, whose {those} older than {remade}",
            "one chain",
            f"Run {', '.join(dict.fromkeys(commands))} again, with the options they had.",
        )

    def _without(self, stage: str) -> DsnetError:
        having = f"run {self.name!r} without {stage!r}"
        remedy = f"Run `dsnet {command_of(stage)} --run {self.name}` or `./reproduce.sh` first."
        if not self.path.is_dir():
            names = sorted({p.parent.parent.name for p in runs_root().glob("*/*/" + MANIFEST)})
            having = f"unknown run {self.name!r} (known: {', '.join(names) or 'none'})"
            remedy = did_you_mean(self.name, names, remedy)
        return DsnetError(having, f"a finished stage {stage!r} in {self.path}", remedy)

    def build(
        self,
        stage: str,
        config: Any,
        make: Callable[[ArtifactWriter], None],
        *,
        data: DataOrigin,
        upstream: Mapping[str, Artifact | Path],
    ) -> Artifact:
        """Make the artifact of `stage` unless one of the same inputs and configuration exists.

        `make` fills the writer; when it is interrupted, its work stays, and the next call with the
        same inputs finds its checkpoints there. `config`, a dataclass or a mapping, is saved
        without `run`, so a renamed run stays current. `upstream` are artifacts and paths of input
        files: their digests decide whether the stage is current.
        """
        # As it will be read back, to compare equal.
        given = config if isinstance(config, Mapping) else asdict(config)
        settings = json.loads(json.dumps(given, default=str))
        settings.pop("run", None)
        files = {name: source for name, source in upstream.items() if isinstance(source, Path)}
        places = {name: self._place(path) for name, path in files.items()}
        stamps = {places[name]: stamp_of(path) for name, path in files.items()}
        digests = {
            name: source.content_sha256 if isinstance(source, Artifact) else sha256_of(source)
            for name, source in upstream.items()
        }
        if current := self._current(stage, settings, digests):
            if not is_begun(current.path):
                tidy(current.path)
            return current
        with self.alone(stage):
            # Another process may have made it since.
            if current := self._current(stage, settings, digests):
                return current
            fingerprint = json_sha256([SCHEMA_VERSION, stage, settings, digests])
            writer = ArtifactWriter(self.path / stage, stage, data=data, fingerprint=fingerprint)
            make(writer)
            writer.record_inputs(places, stamps)
            return writer.finish(config=settings, upstream=digests)

    def _place(self, path: Path) -> str:
        """Of an input file: in the run, which may be moved, or anywhere else."""
        whole, home = path.resolve(), self.path.resolve()
        return str(whole.relative_to(home) if whole.is_relative_to(home) else whole)

    def _current(
        self, stage: str, settings: dict[str, Any], digests: dict[str, str]
    ) -> Artifact | None:
        """The finished artifact of `stage`, if it was made from the same."""
        try:
            finished = read_artifact(self.path / stage)
        except DsnetError:  # none, or damaged and about to be made again
            return None
        made_from = finished.manifest["config"], finished.manifest["upstream"]
        return finished if made_from == (settings, digests) else None

    def alone(self, stage: str, *, resumed: bool = True) -> AbstractContextManager[Path]:
        """The work folder of a stage, for one process; see `exclusive`."""
        what = f"stage {stage!r} of run {self.name!r}"
        remedy = "Wait until it has ended, or pass another --run."
        return exclusive(self.path / stage, what, remedy, resumed=resumed)


def best_alignment_of(run: Run) -> str | None:
    """The stage that holds the robust aligner's work: beside the paper's or in its place."""
    if run.finished(ROBUST_ALIGNMENT):
        return ROBUST_ALIGNMENT
    if run.finished(ALIGNMENT):
        aligner = read_artifact(run.path / ALIGNMENT).manifest["config"].get("aligner")
        return ALIGNMENT if aligner == "robust" else None
    return None


def best_alignment(run: Run) -> Artifact:
    """What the robust aligner made of the run's meshes."""
    if stage := best_alignment_of(run):
        return run.artifact(stage)
    raise DsnetError(
        f"run {run.name!r} without an alignment by the robust aligner",
        f"a finished {ROBUST_ALIGNMENT!r} in {run.path}",
        f"Run `dsnet align --aligner both --run {run.name}` first.",
    )


def body_model_path(run: Run) -> Path:
    """The SMPL model file that the run was aligned with: the licensed one, or the corpus's."""
    licensed = run.artifact(ALIGNMENT).manifest["config"].get("smpl")
    return Path(licensed) if licensed else corpus_body_path(run.artifact("corpus"))


def corpus_body_path(corpus: Artifact) -> Path:
    """The SMPL model file in a `corpus` artifact."""
    return corpus.file(next(n for n in corpus.manifest["files"] if n.startswith("SMPL_")))
