"""`dsnet check`: whether a run is as it was written, and one chain."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from bridge.errors import DsnetError
from bridge.runs.artifact import read_artifact
from bridge.runs.files import is_finished
from bridge.runs.run import STAGES, Run


@dataclass(frozen=True)
class CheckConfig:
    """Read every file of a run again and compare it with its digest; compare all stages' origins.

    Costs two seconds a gigabyte. Prints a line a stage; exits with 2 if anything is not as it was.
    """

    run: str = "demo"
    """Name of the run."""


PROFILES = {name: CheckConfig() for name in ("smoke", "demo", "paper")}


def main(config: CheckConfig) -> None:
    run = Run(config.run)
    folders = sorted(path for path in run.path.glob("[!.]*") if path.is_dir())
    stages = [path.name for path in folders if path.name in STAGES or is_finished(path)]
    if not stages:
        run.artifact("corpus")
    faults = [fault for fault in (_fault(run, stage) for stage in stages) if fault]
    for folder in folders:
        if folder.name not in stages:
            sys.stdout.write(f"{folder.name:<12} is not a stage of dsnet, left alone\n")
    if faults:
        raise faults[0]
    run.check_chain(stages)
    sys.stdout.write(f"run {run.name!r}: {len(stages)} stages, one chain\n")


def _fault(run: Run, stage: str) -> DsnetError | None:
    try:
        run.finished(stage)
        artifact = read_artifact(run.path / stage)
        artifact.verify()
    except DsnetError as error:
        sys.stdout.write(f"{stage:<12} FAULT\n")
        return error
    sizes = [(artifact.path / name).stat().st_size for name in artifact.digests]
    sys.stdout.write(f"{stage:<12} {len(sizes):>3} files {sum(sizes) / 1e6:>9.1f} MB as written\n")
    return None
