"""`dsnet check`: whether a run is as it was written, and one chain."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from bridge.errors import DsnetError
from bridge.runs.artifact import Artifact, read_artifact
from bridge.runs.chain import Chain, is_made
from bridge.runs.run import BENCH, Run


@dataclass(frozen=True)
class CheckConfig:
    """Read every file of a run again and compare it with its digest; compare all stages' origins.

    Costs two seconds a gigabyte. Prints a line a stage; exits with 2 if anything is not as it was.
    """

    run: str = "demo"
    """Name of the run."""


PROFILES = {name: CheckConfig() for name in ("smoke", "demo", "paper")}


def main(config: CheckConfig) -> None:
    """Check all stages, print what was found, and refuse the run for its first fault.

    Raises
    ------
    DsnetError
        If there is no such run, a file changed, a folder has lost its manifest, or a stage is older
        than what it was made from.
    """
    run = Run(config.run)
    there = (path.name for path in run.path.glob("[!.]*") if path.is_dir())
    stages = sorted(name for name in there if name != BENCH)
    if not stages:
        run.artifact("corpus")
    faults = [fault for fault in (_fault(run, stage) for stage in stages) if fault]
    if faults:
        raise faults[0]
    Chain(run.path).check(stages)
    sys.stdout.write(f"run {run.name!r}: {len(stages)} stages, one chain\n")


def _fault(run: Run, stage: str) -> DsnetError | None:
    """Check one stage's files and print the line on it."""
    try:
        is_made(run.path / stage)
        artifact = read_artifact(run.path / stage)
        artifact.verify()
    except DsnetError as error:
        sys.stdout.write(f"{stage:<10} FAULT\n")
        return error
    sys.stdout.write(f"{stage:<10} {_size(artifact)} as written\n")
    return None


def _size(artifact: Artifact) -> str:
    files = [artifact.path / name for name in artifact.digests]
    megabytes = sum(path.stat().st_size for path in files) / 1e6
    return f"{len(files):>3} files {megabytes:>9.1f} MB"
