"""The chain of a run: whether its stages were made from one another as they are now."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from bridge.errors import DsnetError
from bridge.runs.artifact import Artifact, read_artifact
from bridge.runs.digests import cached_sha256s
from bridge.runs.folders import MANIFEST, is_finished

# Artifacts that are not named after the command that makes them.
_MADE_BY = {"truth": "corpus", "align_robust": "align"}


class Chain:
    """Compares the digests of what stages were made from with what lies in a run's folder.

    What was deleted since cannot be compared and is passed over.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._seen: dict[str, bool] = {}
        self._entered: set[str] = set()
        self._changed: list[str] = []

    def check(self, stages: Iterable[str]) -> None:
        """Refuse stages that are older than what they, or those before them, were made from.

        Raises
        ------
        DsnetError
            That names the stages to run again, in order.
        """
        for stage in stages:
            self._is_old(stage)
        old = [stage for stage, is_old in self._seen.items() if is_old]
        if not old:
            return
        run = self._folder.name
        newer = ", ".join(repr(name) for name in dict.fromkeys(self._changed))
        those = f"stages {', '.join(old)} are" if len(old) > 1 else f"stage {old[0]} is"
        commands = (f"`dsnet {command_of(stage)} --run {run}`" for stage in old)
        raise DsnetError(
            f"run {run!r}, whose {those} older than {newer}",
            "one chain",
            f"Run {', '.join(dict.fromkeys(commands))} again, with the options they had.",
        )

    def _is_old(self, stage: str) -> bool:
        if stage not in self._seen:
            if stage in self._entered:
                raise DsnetError(
                    f"stage {stage!r} of {self._folder}, which was made from itself",
                    "one chain",
                    "Delete its folder and run its stage again.",
                )
            self._entered.add(stage)
            artifact = read_artifact(self._folder / stage)
            files = self._files(artifact)
            # A list: each source is looked at, so that each is named.
            changed = [
                self._has_changed(artifact, name, files) for name in artifact.manifest["upstream"]
            ]
            self._seen[stage] = any(changed)
        return self._seen[stage]

    def _files(self, artifact: Artifact) -> dict[str, str]:
        """Digests of the input files of an artifact that are there, as they are now."""
        inputs = artifact.manifest["provenance"].get("inputs", {})
        there = {n: path for n, given in inputs.items() if (path := self._folder / given).is_file()}
        return dict(zip(there, cached_sha256s(there.values()), strict=True))

    def _has_changed(self, artifact: Artifact, name: str, files: Mapping[str, str]) -> bool:
        """Whether one source of an artifact is old itself, or not what the artifact was made of."""
        recorded = artifact.manifest["upstream"][name]
        given = artifact.manifest["provenance"].get("inputs", {}).get(name)
        if given is not None:
            present = files.get(name, recorded)
        elif is_made(self._folder / name):
            if self._is_old(name):
                return True
            present = read_artifact(self._folder / name).content_sha256
        else:
            return False
        if present != recorded:
            self._changed.append(given or name)
        return present != recorded


def is_made(folder: Path) -> bool:
    """Whether a stage's folder is there, finished.

    Raises
    ------
    DsnetError
        If it has lost its manifest, which is damage, not a stage that was never made.
    """
    for _ in range(2):  # another process may have put it into place between the two questions
        if is_finished(folder):
            return True
        if not folder.exists():
            return False
    raise DsnetError(
        f"{folder}, which has lost its {MANIFEST}",
        "the folder of a finished stage, or none",
        f"Run `dsnet {command_of(folder.name)} --run {folder.parent.name}` again, with the options "
        "that it had.",
    )


def command_of(stage: str) -> str:
    """The command that makes a stage."""
    return _MADE_BY.get(stage, stage.replace("_", "-"))
