"""How the stages grow with the number of sequences, where each is short.

    python -m benchmarks.many_sequences --sequences 250

Makes a run of so many sequences of 8 to 30 frames, half of them meshes and half of them motions
that are only predicted, and one of twice as many, one person for twenty; nothing is simulated
(`benchmarks.scaling.smooth_corpus`). Every later stage is run on both with as little training as
it allows. Its CPU time, less what its imports take, should double; where it grows by more than
2.6, the row is marked. `--sequences 2500` is the corpus of 5,000; it takes 60 GB of disk.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import tyro

from benchmarks.scaling.measured_child import ChildUse, measured
from benchmarks.scaling.smooth_corpus import SmoothCorpus, short_lengths
from bridge.errors import DsnetError
from bridge.motion.motion import MOST_FRAMES
from bridge.runs import Run
from bridge.runs.files import runs_root
from bridge.runs.writer import provenance
from dsnet.cli import COMMANDS

TOO_STEEP = 2.6
"""Growth of the time at twice as many sequences: 2 is in proportion, 4 is quadratic."""
_PER_PERSON = 20


@dataclass(frozen=True)
class Little:
    """How a stage is called."""

    options: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    """Fields that are no options."""


LITTLE = {
    "align": Little("--aligner both --steps 1", {"first_frame_steps": 60, "shape_steps": 100}),
    "train-ae": Little("--steps 2", {"validate_every": 1, "validation_frames": 64}),
    "encode": Little(),
    "train": Little("--epochs 1 --rounds 3", {"plus": {"steps": 1, "nodes": 100}}),
    "infer": Little(),
    "decode": Little(),
    "evaluate": Little(),
    "report": Little("", {"panel_px": 60}),
    "check": Little(),
}
"""As little work of every stage as it allows."""


@dataclass(frozen=True)
class ManySequencesConfig:
    """Run every stage on N and on 2 N short sequences."""

    sequences: int = 250
    """N."""
    frames: tuple[int, int] = (8, 30)
    """Fewest and most frames of a sequence."""
    out: Path = Path("docs/results/scaling/many_sequences.json")
    """The results, which `python -m tools.update_pages scaling` makes a page of."""
    keep: bool = False
    """Keep the runs, which lie below DSNET_RUNS or `runs/`."""


def main(config: ManySequencesConfig) -> None:
    """Measure, print the table, write it."""
    sizes = config.sequences, 2 * config.sequences
    starts = {stage: start_s(stage) for stage in LITTLE}
    found = {size: _stages(size, config) for size in sizes}
    result = {
        "sequences": list(sizes),
        "frames": list(config.frames),
        "limit": TOO_STEEP,
        "machine": provenance(0.0)["machine"],
        "command": " ".join(["python -m benchmarks.many_sequences", *sys.argv[1:]]),
        "stages": {
            stage: {"start_s": start, "measured": [asdict(found[size][stage]) for size in sizes]}
            for stage, start in starts.items()
        },
    }
    sys.stdout.write(as_page(result))
    config.out.parent.mkdir(parents=True, exist_ok=True)
    config.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def start_s(stage: str) -> float:
    """CPU seconds until a stage's module is loaded."""
    return measured([sys.executable, "-c", f"import {COMMANDS[stage][0]}"], {}).cpu_s


def _stages(size: int, config: ManySequencesConfig) -> dict[str, ChildUse]:
    run = Run(f"many_sequences_{size}")
    least, most = config.frames
    if not 4 <= least <= most < MOST_FRAMES:
        raise DsnetError(f"--frames {least} {most}", "the least, from 4 on, then the most", "Swap.")
    half = size // 2
    lengths = tuple(short_lengths(size, least, most))
    corpus = SmoothCorpus(lengths[:half], lengths[half:], max(half // _PER_PERSON, 2))
    corpus.write(run)
    found = {}
    for stage, little in LITTLE.items():
        found[stage] = run_stage(stage, run, little)
        sys.stderr.write(f"{size} sequences, {stage}: {found[stage].cpu_s:.1f} s\n")
    if not config.keep:
        shutil.rmtree(run.path)
    return found


def run_stage(stage: str, run: Run, little: Little) -> ChildUse:
    """One stage of a run as a process, with profile `smoke`."""
    runs = str(runs_root().resolve())
    return measured(stage_command(stage, run.name, little), {"DSNET_RUNS": runs})


def stage_command(stage: str, run: str, little: Little) -> list[str]:
    """What runs a stage with profile `smoke`."""
    call = (
        "import json, sys; from dsnet.cli import main; "
        "main(sys.argv[2:], **json.loads(sys.argv[1]))"
    )
    profile = [] if stage == "check" else ["--profile", "smoke"]
    command = [stage, *profile, "--run", run, *little.options.split()]
    return [sys.executable, "-c", call, json.dumps(little.settings), *command]


def growth(stage: dict[str, Any]) -> float:
    """Of the time beyond the start, from N to 2 N sequences."""
    few, many = (one["cpu_s"] - stage["start_s"] for one in stage["measured"])
    return many / max(few, 1e-9)


def as_page(result: dict[str, Any]) -> str:
    """The results as Markdown."""
    few, many = result["sequences"]
    least, most = result["frames"]
    lines = [
        f"Written by `{result['command']}`: smooth functions in "
        f"place of motions and offsets, {least} to {most} frames a sequence, as little training as "
        f"a stage allows. CPU seconds beyond the imports; {result['machine']}.",
        "",
        f"| stage | {few:,} sequences [s] | {many:,} sequences [s] | growth "
        "| anonymous memory [MB] | with mapped files [MB] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name, stage in result["stages"].items():
        own_s = [f"{one['cpu_s'] - stage['start_s']:.1f}" for one in stage["measured"]]
        memory = [
            " to ".join(f"{one[key]:,.0f}" for one in stage["measured"])
            for key in ("anonymous_mb", "resident_mb")
        ]
        found = growth(stage)
        mark = " **too steep**" if found > result["limit"] else ""
        cells = [f"`{name}`", *own_s, f"{found:.1f}{mark}", *memory]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(ManySequencesConfig))
