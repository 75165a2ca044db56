"""`python -m benchmarks.alignment.compare --out DIR`: aligners and peers on the same sequences.

Writes DIR/compare_<suite>.json, the same as a table in compare_<suite>.md, and figures. Simulated
meshes are kept in DIR/sequences: 20 MB and a few seconds each. The results file holds the seconds
of every round.
"""

from __future__ import annotations

import json
import os
import platform
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from statistics import median
from typing import Any

import torch
from tqdm import tqdm

from benchmarks.alignment.compare_page import draw_figures, markdown
from benchmarks.alignment.contenders import TITLES, Estimate, contenders
from benchmarks.alignment.known_sequences import (
    HELD_OUT,
    TUNING,
    KnownSequence,
    Suite,
    known_sequences,
)
from benchmarks.alignment.scores import Scores, body_of, loads_of
from benchmarks.processes import run_as_process
from bridge.errors import DsnetError
from bridge.runs.files import write_text_atomically
from bridge.runs.writer import machine
from torch_align_ae.alignment.sgd import Descent


@dataclass(frozen=True)
class CompareConfig:
    """Compare the paper's aligner, smplfitter and ours where the truth is known."""

    out: Path
    """Folder that receives the results; simulated sequences are kept in it."""
    held_out: bool = False
    """Sequences that no aligner was tuned on, in place of the tuning set."""
    contenders: tuple[str, ...] = tuple(TITLES)
    """Which aligners, by name."""
    rounds: int = 3
    """Timed repetitions of each aligner, turn by turn; the median counts. The paper's SGD, which
    takes as long as all the others several times over, has one."""
    threads: int = 2
    """Arithmetic threads."""
    steps: int = 140
    """SGD steps for each frame after a sequence's first, as in the profile `demo`."""
    first_frame_steps: int = 2000
    """SGD steps for the pose of a first frame."""
    shape_steps: int = 8000
    """SGD steps for a subject's shape."""
    panel_px: int = 420
    """Height of one rendered body."""


def main(config: CompareConfig) -> None:
    """Measure, write the results and draw.

    Raises
    ------
    DsnetError
        If there is no such contender.
    """
    compare(config, HELD_OUT if config.held_out else TUNING)


def compare(config: CompareConfig, suite: Suite) -> dict[str, Any]:
    """Compare on the sequences of `suite`; returns what compare_<suite>.json holds."""
    if unknown := sorted(set(config.contenders) - set(TITLES)):
        raise DsnetError(f"contenders {unknown}", f"among {list(TITLES)}", "Check their names.")
    known = known_sequences(suite, config.out / "sequences")
    torch.set_num_threads(config.threads)
    with tempfile.TemporaryDirectory() as folder:
        estimates, seconds = _align_in_turns(config, known, Path(folder))
    loads = [loads_of(one) for one in known]
    scores = {name: Scores() for name in estimates}
    for name, found in estimates.items():
        for one, load, estimate in zip(known, loads, found, strict=True):
            scores[name].add(one, load, estimate)
    frames = sum(len(one.theta) for one in known)
    results = {
        "data": "synthetic",
        "suite": asdict(suite),
        "aligners": {
            name: {
                "title": TITLES[name],
                "frames_per_s": frames / median(seconds[name]),
                "seconds": seconds[name],
                **score.summary(),
            }
            for name, score in scores.items()
        },
        "provenance": _provenance(config),
    }
    stem = config.out / f"compare_{suite.name}"
    write_text_atomically(stem.with_suffix(".json"), json.dumps(results, indent=1) + "\n")
    write_text_atomically(stem.with_suffix(".md"), markdown(results))
    draw_figures(config.out, suite.name, known, estimates, scores, config.panel_px)
    return results


def _align_in_turns(
    config: CompareConfig, known: Sequence[KnownSequence], folder: Path
) -> tuple[dict[str, list[Estimate]], dict[str, list[float]]]:
    """Estimates, and seconds of every round, each summed over the genders' own calls."""
    descent = Descent(
        steps=config.steps,
        first_frame_steps=config.first_frame_steps,
        shape_steps=config.shape_steps,
    )
    makers = contenders(descent, folder)
    genders = sorted({one.recording.gender for one in known})
    rows = {g: [i for i, one in enumerate(known) if one.recording.gender == g] for g in genders}
    ready = {
        name: {
            gender: makers[name](body_of(gender), [known[row].recording for row in rows[gender]])
            for gender in genders
        }
        for name in config.contenders
    }
    estimates: dict[str, dict[int, Estimate]] = {name: {} for name in ready}
    seconds: dict[str, list[float]] = {name: [] for name in ready}
    turns = [n for turn in range(config.rounds) for n in ready if turn == 0 or n != "sgd"]
    for name in tqdm(turns, desc="align", unit="aligner", disable=None):
        taken_s = 0.0
        for gender, align in ready[name].items():
            started = time.perf_counter()
            found = align()
            taken_s += time.perf_counter() - started
            estimates[name].update(zip(rows[gender], found, strict=True))
        seconds[name].append(taken_s)
    in_order = {name: [found[row] for row in sorted(found)] for name, found in estimates.items()}
    return in_order, seconds


def _provenance(config: CompareConfig) -> dict[str, Any]:
    packages = ("numpy", "scipy", "torch", "smplfitter")
    return {
        "command": "python -m benchmarks.alignment.compare --out DIR"
        + (" --held-out" if config.held_out else ""),
        "config": {key: value for key, value in asdict(config).items() if key != "out"},
        "machine": f"{machine()}, {os.cpu_count()} cores",
        "finished_utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": {
            "python": platform.python_version(),
            **{package: metadata.version(package) for package in packages},
        },
    }


if __name__ == "__main__":
    run_as_process(CompareConfig, main)
