"""Every stage from `align` to `report` at the paper's size: its memory, and two kills in it.

    python -m benchmarks.full_size

Writes the paper's 67 sequences of 21,502 meshes as smooth functions, which takes no simulation
(`benchmarks.scaling.smooth_corpus`), and runs each stage on them with as little training as it
allows: a step or an epoch holds all that many hold. Then a second run of the same corpus, in which
each stage is killed twice, at seeded shares of the time that it took undisturbed, called again each
time, and at last left alone. Both runs have to hold the same bytes. The whole takes 35 GB of disk
and, on two cores, about half an hour; `--share 0.1` is a tenth of it.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from benchmarks.many_sequences import LITTLE, Little, run_stage, stage_command
from benchmarks.scaling.smooth_corpus import SmoothCorpus
from bridge.runs import Run, read_artifact
from bridge.runs.files import MANIFEST, runs_root, write_text_atomically
from bridge.runs.writer import provenance
from dsnet.synthetic.recordings import CorpusConfig, plan_of

LIMIT_MB = 4096
"""Of anonymous memory: what is asked of every stage."""
STAGES = {stage: options for stage, options in LITTLE.items() if stage != "check"}
_TEST_MOTIONS, _TEST_FRAMES, _PEOPLE = 12, 300, 5
_SHARES = (0.2, 0.5), (0.3, 0.7)
_PRINTS_SECONDS = ("report.html", "report.md", "results.json")
"""Of `report`: how long the stages took, which no two runs share."""


@dataclass(frozen=True)
class FullSizeConfig:
    """Measure each stage at the paper's size, and kill it twice."""

    share: float = 1.0
    """Of the frames of each sequence."""
    seed: int = 0
    """Of the moments of the kills."""
    out: Path = Path("docs/results/reliability/full_size.json")
    """The results."""
    keep: bool = False
    """Keep both runs, which lie below DSNET_RUNS or `runs/`."""


@dataclass(frozen=True)
class Kill:
    """When a stage was killed, and where that found it."""

    after_s: float
    found: str
    """`cut` or `finished`: it was still running in either case."""


def main(config: FullSizeConfig) -> None:
    """Measure, kill, write the results."""
    corpus, rng, stages = corpus_of(config.share), random.Random(config.seed), {}
    calm, disturbed = Run("full_size"), Run("full_size_killed")
    corpus.write(calm)
    link_files(calm.path, disturbed.path)
    for stage, little in STAGES.items():
        used = run_stage(stage, calm, little)
        sys.stderr.write(f"{stage}: {used.wall_s:.0f} s, {used.anonymous_mb:,.0f} MB\n")
        stages[stage] = asdict(used)
    for stage, little in STAGES.items():
        moments = [rng.uniform(*share) * stages[stage]["wall_s"] for share in _SHARES]
        kills = [killed(stage, little, disturbed, after_s) for after_s in moments]
        again_s = run_stage(stage, disturbed, little).wall_s
        differ = differing(stage, disturbed, calm)
        sys.stderr.write(f"{stage}: {kills}, then {again_s:.0f} s, differ: {differ}\n")
        stages[stage] |= {"kills": [*map(asdict, kills)], "again_s": again_s, "differ": differ}
    if not config.keep:
        shutil.rmtree(calm.path)
        shutil.rmtree(disturbed.path)
    result = {
        "sequences": len(corpus.lengths),
        "frames": sum(corpus.lengths),
        "limit_mb": LIMIT_MB,
        "seed": config.seed,
        "machine": provenance(0.0)["machine"],
        "command": " ".join(["python -m benchmarks.full_size", *sys.argv[1:]]),
        "stages": stages,
    }
    config.out.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out, json.dumps(result, indent=1) + "\n")


def corpus_of(share: float) -> SmoothCorpus:
    """The paper's sequences, each cut to a share of its frames, and some test motions."""
    takes = plan_of(CorpusConfig(subjects=_PEOPLE)).dyna
    lengths = tuple(max(round(share * take.frame_count), 8) for take in takes)
    tests = (max(round(share * _TEST_FRAMES), 8),) * _TEST_MOTIONS
    return SmoothCorpus(lengths, tests, _PEOPLE)


def link_files(source: Path, target: Path) -> None:
    """A folder whose files are links to those of `source`."""
    shutil.copytree(source, target, copy_function=os.link)


def killed(stage: str, little: Little, run: Run, after_s: float) -> Kill:
    """Begin a stage; SIGKILL for it and all that it has started; sooner if it has ended by then."""
    child = subprocess.Popen(
        stage_command(stage, run.name, little),
        env={**os.environ, "DSNET_RUNS": str(runs_root().resolve())},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    time.sleep(after_s)
    if child.poll() is not None:
        for path in made_by(stage, run):
            shutil.rmtree(path)
        return killed(stage, little, run, 0.6 * after_s)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    finished = all((path / MANIFEST).exists() for path in made_by(stage, run))
    return Kill(after_s, "finished" if finished else "cut")


def differing(stage: str, run: Run, calm: Run) -> list[str]:
    """Files of a stage that are not the same in both runs."""
    found = []
    for here, there in zip(made_by(stage, run), made_by(stage, calm), strict=True):
        one, other = read_artifact(here), read_artifact(there)
        one.verify()
        found += [
            f"{here.name}/{name}"
            for name in sorted({*one.digests, *other.digests} - {*_PRINTS_SECONDS})
            if one.digests.get(name) != other.digests.get(name)
        ]
    return found


def made_by(stage: str, run: Run) -> list[Path]:
    """Folders of the artifacts of a stage."""
    beside = {"align": "align_robust", "train": "train_plus", "infer": "infer_plus"}
    return [run.path / name for name in (stage, beside.get(stage)) if name]


if __name__ == "__main__":
    main(tyro.cli(FullSizeConfig))
