"""Measure the stages that use a pool with 1 and 2 workers, on corpora of three sizes.

    python -m benchmarks.scaling                            # on a quiet machine
    python -m benchmarks.scaling --profile smoke --sizes 2 3 4 --out OUT

The first writes docs/results/scaling/scaling.json, which `python -m tools.update_pages scaling`
makes a page of; the second shows that it works. Every stage is a process of its own, in a
folder of runs that is removed at the end.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from benchmarks.scaling.model import predicted_and_measured
from benchmarks.scaling.overhead import overheads
from bridge.options import PositiveInt
from bridge.runs.artifact import read_artifact
from bridge.runs.writer import provenance

MOTIONS = ("hips", "one_leg_jump", "shake_arms", "jumping_jacks", "jiggle_on_toes",
           "shake_hips", "running_on_spot", "light_hopping_loose")  # fmt: skip
_OBSERVED = "from benchmarks.scaling.observed import main; main()"
_STAGES = {"corpus": "truth", "align": "align", "infer": "infer_plus"}
"""Commands that are measured, and the artifact that says how many frames that took."""


@dataclass(frozen=True)
class ScalingConfig:
    """Measure throughput, overhead and bytes; see the module."""

    profile: Literal["smoke", "demo"] = "demo"
    """Whose settings of the stages."""
    sizes: tuple[int, ...] = (2, 5, 8)
    """Motions a person, of two people: three sizes, at most 8."""
    mean_frames: PositiveInt = 72
    """Mean length of a sequence."""
    workers: tuple[int, ...] = (1, 2)
    """Workers of a pool; the model is drawn from 1."""
    tasks: PositiveInt = 500
    """Empty tasks, for what a pool costs."""
    ray: bool = True
    """Whether Ray's pool is measured where Ray is installed."""
    out: Path = Path("docs/results/scaling")
    """Folder to write."""


def main(config: ScalingConfig) -> None:
    """Measure, write the file, print what the model says of each."""
    with tempfile.TemporaryDirectory(prefix="dsnet_scaling_") as folder:
        measured = list(_measured(config, Path(folder)))
        facts = _facts(Path(folder), config)
    results = {
        "machine": provenance(0.0)["machine"],
        "profile": config.profile,
        "measured": measured,
        "overheads": overheads(config.tasks, config.ray),
        **facts,
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "scaling.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    rows = predicted_and_measured(measured)
    for row in rows:
        sys.stdout.write(
            f"{row['stage']:<14}{row['frames']:>7} frames {row['workers']} workers: "
            f"{row['wall_s']:.2f} s, predicted {row['predicted_s']:.2f} s, "
            f"{100 * row['relative_error']:+.0f} %\n"
        )


def _measured(config: ScalingConfig, runs: Path) -> Iterator[dict[str, Any]]:
    for size in config.sizes:
        for workers in config.workers:
            run = _run_name(size, workers)
            for command, (options, settings) in _chain(config, size).items():
                observed = _observe(runs, workers, settings, command, "--profile", config.profile,
                                    "--run", run, *options)  # fmt: skip
                if command in _STAGES:
                    manifest = read_artifact(runs / run / _STAGES[command]).manifest
                    frames = sum(one["length"] for one in manifest["sequences"])
                    own = {"stage": command, "sequences": len(manifest["sequences"])}
                    yield {**own, "frames": frames, "workers": workers, **observed}


def _chain(config: ScalingConfig, size: int) -> dict[str, tuple[tuple[str, ...], dict[str, Any]]]:
    """Commands in their order, with options and other settings.

    Mechanics are learned in no time, if badly. What is predicted grows with what is trained on:
    every motion is done again.
    """
    corpus = ("--subjects", "2", "--motions", *MOTIONS[:size], "--mean-frames",
              str(config.mean_frames), "--mosh-seconds", "1.2",
              "--mosh-motions", "side_to_side_hopping")  # fmt: skip
    return {
        "corpus": (corpus, {"retakes": size, "crossing": "rotating"}),
        "align": (("--aligner", "robust"), {}),
        "train": (("--predictors", "dsnet_plus", "--rounds", "1"), {"plus": {"steps": 2}}),
        "infer": ((), {}),
    }


def _observe(runs: Path, workers: int, settings: dict[str, Any], *command: str) -> dict[str, Any]:
    out = runs / "observed.json"
    environment = {**os.environ, "DSNET_RUNS": str(runs)}
    subprocess.run(
        [sys.executable, "-c", _OBSERVED, str(workers), str(out), json.dumps(settings), *command],
        env=environment,
        check=True,
    )
    return json.loads(out.read_text(encoding="utf-8"))


def _facts(runs: Path, config: ScalingConfig) -> dict[str, Any]:
    """Of the largest corpus: what its manifest takes, and how fast a digest is."""
    run = runs / _run_name(config.sizes[-1], config.workers[0])
    sequences = read_artifact(run / "align").manifest["sequences"]
    block = bytes(1 << 26)
    started = time.perf_counter()
    hashlib.sha256(block)
    seconds = time.perf_counter() - started
    return {
        "manifest_bytes": len(json.dumps(sequences, indent=1)) / len(sequences),
        "digest_mb_s": len(block) / 1e6 / seconds,
    }


def _run_name(size: int, workers: int) -> str:
    return f"size{size}_workers{workers}"


if __name__ == "__main__":
    main(tyro.cli(ScalingConfig))
