"""A run: the folder `runs/<run>/`, one artifact a stage, each made at most once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bridge.errors import DsnetError, InterruptedWorkError, did_you_mean
from bridge.runs.artifact import SCHEMA_VERSION, Artifact, DataOrigin, read_artifact
from bridge.runs.chain import Chain, command_of, is_made
from bridge.runs.digests import cached_sha256s, json_sha256
from bridge.runs.folders import (
    MANIFEST,
    is_unsettled,
    runs_root,
    settle,
)
from bridge.runs.locks import exclusive, lock_of
from bridge.runs.writer import ArtifactWriter

ALIGNMENT = "align"
# Beside the paper's aligner's, of the same meshes.
ROBUST_ALIGNMENT = "align_robust"

BENCH = "bench"
"""A folder in a run that is no stage's."""


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
        """Whether there is an artifact of `stage`, current or not; as `is_made`."""
        if is_unsettled(self.path / stage):
            # Left by a process that was killed while it put the artifact into place; if another
            # one holds the stage, it is alive and does so itself.
            with suppress(DsnetError, OSError), self.alone(stage):
                settle(self.path / stage)
        return is_made(self.path / stage)

    def artifact(self, stage: str) -> Artifact:
        """The finished artifact of `stage`, which is one chain with all that it was made from.

        Raises
        ------
        DsnetError
            If there is none, or if something before it was made again since.
        """
        return self.artifacts(stage)[stage]

    def artifacts(self, *stages: str) -> dict[str, Artifact]:
        """The finished artifacts of several stages, by name; see `artifact`."""
        for stage in stages:
            if not self.finished(stage):
                raise self._unfinished(stage)
        Chain(self.path).check(stages)
        return {stage: read_artifact(self.path / stage) for stage in stages}

    def _unfinished(self, stage: str) -> DsnetError:
        having = f"run {self.name!r} without {stage!r}"
        remedy = f"Run `dsnet {command_of(stage)} --run {self.name}` or `./reproduce.sh` first."
        if not self.path.is_dir():
            names = sorted({p.parent.parent.name for p in runs_root().glob("*/*/" + MANIFEST)})
            having = f"unknown run {self.name!r} (known: {', '.join(names) or 'none'})"
            remedy = did_you_mean(self.name, names, remedy)
        return DsnetError(
            having,
            f"a finished stage {stage!r} in {self.path}",
            remedy,
        )

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

        Parameters
        ----------
        config : dataclass instance
            Saved in the manifest; `run` is left out, so a renamed run stays current.
        make : callable
            Fills the writer. When it is interrupted, its partial folder stays,
            and the next call with the same inputs finds its checkpoints there.
        upstream : mapping of name to Artifact or path of an input file
            Their content digests enter the manifest and decide whether the stage is current.

        Raises
        ------
        DsnetError
            If another process is making this stage of this run.
        """
        settings = {key: _plain(value) for key, value in asdict(config).items() if key != "run"}
        digests = _digests(upstream)
        if current := self._current(stage, settings, digests):
            self._remove_lock(stage)
            return current
        with self.alone(stage):
            settle(self.path / stage)
            # Another process may have made it since.
            if current := self._current(stage, settings, digests):
                return current
            fingerprint = json_sha256([SCHEMA_VERSION, stage, settings, digests])
            writer = ArtifactWriter(self.path / stage, stage, data=data, fingerprint=fingerprint)
            try:
                make(writer)
            except InterruptedWorkError:
                raise
            except DsnetError:
                writer.discard()
                raise
            writer.record_measured(inputs=self._inputs(upstream))
            return writer.finish(config=settings, upstream=digests)

    def _current(
        self, stage: str, settings: dict[str, Any], digests: dict[str, str]
    ) -> Artifact | None:
        """The finished artifact of `stage`, if it was made from the same."""
        try:
            if not self.finished(stage):
                return None
            finished = read_artifact(self.path / stage)
        except DsnetError:  # damaged, and about to be made again
            return None
        made_from = finished.manifest["config"], finished.manifest["upstream"]
        return finished if made_from == (settings, digests) else None

    def _remove_lock(self, stage: str) -> None:
        """Remove a lock that a killed process left; if another one holds it, that one does."""
        if lock_of(self.path / stage).exists():
            with suppress(DsnetError, OSError), self.alone(stage):
                pass

    def _inputs(self, upstream: Mapping[str, Artifact | Path]) -> dict[str, str]:
        """Where input files lie: in the run, which may be moved, or anywhere else."""
        home = self.path.resolve()
        files = {n: p.resolve() for n, p in upstream.items() if not isinstance(p, Artifact)}
        return {
            name: str(path.relative_to(home) if path.is_relative_to(home) else path)
            for name, path in files.items()
        }

    def alone(self, stage: str) -> AbstractContextManager[None]:
        """Keep other processes out of `stage`."""
        return exclusive(
            self.path / stage,
            f"stage {stage!r} of run {self.name!r}",
            "Wait until it has ended, or pass another --run.",
        )


def _digests(upstream: Mapping[str, Artifact | Path]) -> dict[str, str]:
    """Of what a stage is made from, in its order."""
    files = {name: source for name, source in upstream.items() if isinstance(source, Path)}
    of_files = dict(zip(files, cached_sha256s(files.values()), strict=True))
    return {
        name: source.content_sha256 if isinstance(source, Artifact) else of_files[name]
        for name, source in upstream.items()
    }


def _plain(value: Any) -> Any:
    """The JSON form of a configuration value, so that it compares equal after reading it back."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def best_alignment(run: Run) -> Artifact:
    """What the robust aligner made of the run's meshes: beside the paper's alignment or in its
    place.

    Raises
    ------
    DsnetError
        If only the paper's aligner was used, or none, or what it was made from is newer.
    """
    if run.finished(ROBUST_ALIGNMENT):
        return run.artifact(ROBUST_ALIGNMENT)
    if run.finished(ALIGNMENT):
        align = run.artifact(ALIGNMENT)
        if align.manifest.get("aligner") == "robust":
            return align
    raise DsnetError(
        f"run {run.name!r} without an alignment by the robust aligner",
        f"a finished {ROBUST_ALIGNMENT!r} in {run.path}",
        f"Run `dsnet align --aligner both --run {run.name}` first.",
    )


def body_model_path(run: Run) -> Path:
    """The SMPL model file that the run was aligned with: the licensed one, or the corpus's."""
    licensed = run.artifact("align").manifest["config"].get("smpl")
    return Path(licensed) if licensed else corpus_body_path(run.artifact("corpus"))


def corpus_body_path(corpus: Artifact) -> Path:
    """The SMPL model file in a `corpus` artifact."""
    return corpus.file(next(n for n in corpus.manifest["files"] if n.startswith("SMPL_")))
