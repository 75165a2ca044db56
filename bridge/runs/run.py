"""A run: the folder `runs/<run>/`, one artifact a stage, each made at most once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from bridge.errors import DsnetError, InterruptedWorkError
from bridge.runs.artifact import (
    MANIFEST,
    SCHEMA_VERSION,
    Artifact,
    ArtifactWriter,
    DataOrigin,
    file_sha256,
    json_sha256,
    read_artifact,
)


def runs_root() -> Path:
    """`runs/` below the working directory, or what `DSNET_RUNS` names."""
    return Path(os.environ.get("DSNET_RUNS", "runs"))


class Run:
    """One run's folder and the artifacts in it."""

    def __init__(self, name: str) -> None:
        if not name or name != Path(name).name or name.startswith("."):
            raise DsnetError(
                f"run name {name!r}", "a plain folder name such as 'demo'", "Pass --run NAME."
            )
        self.name = name
        self.path = runs_root() / name

    def artifact(self, stage: str) -> Artifact:
        """The finished artifact of `stage`; DsnetError with the remedy when there is none."""
        if not (self.path / stage / MANIFEST).is_file():
            having = f"run {self.name!r} without {stage!r}"
            if not self.path.is_dir():
                names = sorted({p.parent.parent.name for p in runs_root().glob("*/*/" + MANIFEST)})
                having = f"unknown run {self.name!r} (known: {', '.join(names) or 'none'})"
            raise DsnetError(
                having,
                f"a finished stage {stage!r} in {self.path}",
                f"Run `dsnet {stage} --run {self.name}` or `./reproduce.sh` first.",
            )
        return read_artifact(self.path / stage)

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
        digests = {name: _digest(source) for name, source in upstream.items()}
        if current := self._current(stage, settings, digests):
            return current
        with self._alone(stage):
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
            return writer.finish(config=settings, upstream=digests)

    def _current(
        self, stage: str, settings: dict[str, Any], digests: dict[str, str]
    ) -> Artifact | None:
        """The finished artifact of `stage`, if it was made from the same."""
        if not (self.path / stage / MANIFEST).is_file():
            return None
        finished = read_artifact(self.path / stage)
        made_from = finished.manifest["config"], finished.manifest["upstream"]
        return finished if made_from == (settings, digests) else None

    @contextmanager
    def _alone(self, stage: str) -> Iterator[None]:
        """Keep other processes out of `stage`; the system lets go when a process is killed."""
        # Not in the run's folder, which a refused input leaves as it was.
        locks = runs_root() / ".locks"
        locks.mkdir(parents=True, exist_ok=True)
        lock = FileLock(locks / f"{self.name}.{stage}")
        try:
            lock.acquire(blocking=False)
        except Timeout:
            raise DsnetError(
                f"stage {stage!r} of run {self.name!r}, which another process is making",
                "one process at a time",
                "Wait until it has ended, or pass another --run.",
            ) from None
        try:
            yield
        finally:
            lock.release()


def _digest(source: Artifact | Path) -> str:
    return source.content_sha256 if isinstance(source, Artifact) else file_sha256(source)


def _plain(value: Any) -> Any:
    """The JSON form of a configuration value, so that it compares equal after reading it back."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def body_model_path(run: Run) -> Path:
    """The SMPL model file that the run was aligned with: the licensed one, or the corpus's."""
    licensed = run.artifact("align").manifest["config"].get("smpl")
    return Path(licensed) if licensed else corpus_body_path(run.artifact("corpus"))


def corpus_body_path(corpus: Artifact) -> Path:
    """The SMPL model file in a `corpus` artifact."""
    return corpus.file(next(n for n in corpus.manifest["files"] if n.startswith("SMPL_")))
