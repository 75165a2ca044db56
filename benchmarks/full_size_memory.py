"""Memory of every stage after alignment on a corpus of the paper's size.

    python -m benchmarks.full_size_memory

Writes the paper's 67 sequences of 21,502 frames as smooth functions, which takes no simulation
(`benchmarks.scaling.smooth_corpus`), with the two alignments as if the truth had been found, and
runs each later stage on them with as little training as it allows: a step or an epoch holds all
that many hold. `--align` writes meshes too and aligns them, one step a frame. The whole takes
20 GB of disk and, on two cores, about a quarter of an hour; `--share 0.1` is a tenth of it.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from benchmarks.many_sequences import LITTLE, run_stage
from benchmarks.scaling.smooth_corpus import SmoothCorpus
from bridge.runs import Run
from bridge.runs.provenance import provenance
from torch_align_ae.corpus.motions import DYNA_MOTIONS
from torch_align_ae.corpus.sequences import dyna_takes

LIMIT_MB = 4096
"""Of anonymous memory: what is asked of every stage."""
_TEST_MOTIONS, _TEST_FRAMES, _PEOPLE = 12, 300, 5


@dataclass(frozen=True)
class FullSizeMemoryConfig:
    """Measure the memory of each stage at the paper's size."""

    share: float = 1.0
    """Of the frames of each sequence."""
    align: bool = False
    """Align meshes instead of beginning after `align`."""
    out: Path = Path("docs/results/scaling/full_size_memory")
    """Path of the results, without `.json` and `.md`."""
    keep: bool = False
    """Keep the run, which lies below DSNET_RUNS or `runs/`."""


def main(config: FullSizeMemoryConfig) -> None:
    """Measure, print the table, write it."""
    corpus = corpus_of(config.share)
    run = Run("full_size_memory")
    corpus.write(run, meshes=config.align)
    if not config.align:
        corpus.write_alignments(run)
    stages = {s: options for s, options in LITTLE.items() if config.align or s != "align"}
    found = {}
    for stage, options in stages.items():
        found[stage] = asdict(run_stage(stage, run, options))
        sys.stderr.write(f"{stage}: {found[stage]['anonymous_mb']:,.0f} MB\n")
    if not config.keep:
        shutil.rmtree(run.path)
    result = {
        "sequences": len(corpus.lengths),
        "frames": sum(corpus.lengths),
        "limit_mb": LIMIT_MB,
        "machine": provenance(0.0)["machine"],
        "command": " ".join(["python -m benchmarks.full_size_memory", *sys.argv[1:]]),
        "stages": found,
    }
    table = as_page(result)
    sys.stdout.write(table)
    config.out.parent.mkdir(parents=True, exist_ok=True)
    config.out.with_suffix(".json").write_text(
        json.dumps(result, indent=1) + "\n", encoding="utf-8"
    )
    config.out.with_suffix(".md").write_text(table, encoding="utf-8")


def corpus_of(share: float) -> SmoothCorpus:
    """The paper's sequences, each cut to a share of its frames, and some test motions."""
    takes = dyna_takes("female", _PEOPLE, tuple(DYNA_MOTIONS), 321, 0)
    lengths = tuple(max(round(share * take.frame_count), 8) for take in takes)
    tests = (max(round(share * _TEST_FRAMES), 8),) * _TEST_MOTIONS
    return SmoothCorpus(lengths, tests, _PEOPLE)


def as_page(result: dict[str, Any]) -> str:
    """The results as Markdown."""
    lines = [
        f"Written by `{result['command']}`: {result['sequences']} sequences of "
        f"{result['frames']:,} frames, smooth functions in place of motions and offsets, as little "
        f"training as a stage allows; {result['machine']}. Anonymous memory cannot be taken back "
        "by the system; pages of mapped files can.",
        "",
        "| stage | anonymous memory [MB] | with mapped files [MB] |",
        "|---|---:|---:|",
    ]
    for stage, one in result["stages"].items():
        mark = " **too much**" if one["anonymous_mb"] > result["limit_mb"] else ""
        memory = f"{one['anonymous_mb']:,.0f}{mark} | {one['resident_mb']:,.0f}"
        lines.append(f"| `{stage}` | {memory} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(tyro.cli(FullSizeMemoryConfig))
