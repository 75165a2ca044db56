"""How long `./reproduce.sh` will take in another profile, from what the stages of a run took.

    python -m benchmarks.budget

Each stage's seconds are scaled by what its work is made of: frames, sequences, steps. What a stage
takes to start is scaled too, so that a larger profile is told a little too long. Prints a table.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from benchmarks.processes import run_as_process
from bridge.options import PositiveFloat, PositiveInt
from torch_align_ae.alignment.stage_align import PROFILES as ALIGN
from torch_align_ae.autoencoder.stage_train_ae import PROFILES as TRAIN_AE
from torch_align_ae.corpus.recordings import plan_of
from torch_align_ae.corpus.stage_corpus import PROFILES as CORPUS

_ASK_TRAIN = (
    "import json, sys; from dataclasses import asdict; from tf_dsnet.stage_train import PROFILES; "
    "print(json.dumps(asdict(PROFILES[sys.argv[1]])))"
)
_STEPS_SHARE = 2 / 3
"""Of a round of `dsnet_plus` in `demo`: Adam's steps, which cost the same for any corpus; the rest
is the simulation of all its clips."""
_AGAIN = ("train", "infer", "decode", "train_plus", "infer_plus", "evaluate")
"""Stages that every further seed repeats."""


@dataclass(frozen=True)
class BudgetConfig:
    """Tabulate what a profile's stages will take on the machine of a run that is there."""

    results: Path = Path("docs/results/demo/results.json")
    """Of the run whose stages were timed, in profile `demo` but for its length."""
    profile: Literal["demo", "paper"] = "paper"
    """What is asked for."""
    seeds: PositiveInt = 3
    """How many seeds the predictors are trained from."""
    step_s: PositiveFloat | None = None
    """Seconds of a step of the autoencoder, where that run's are not those to expect."""


@dataclass(frozen=True)
class Work:
    """What the stages of a profile are asked to do."""

    aligned: int  # frames
    sequences: int
    subjects: int
    tested: int  # frames of held-out motions
    align_steps: int  # of SGD, all bodies
    autoencoder_steps: int
    rounds: int
    epochs: int

    @classmethod
    def of(cls, profile: str) -> Work:
        """A profile's."""
        plan, align, code = plan_of(CORPUS[profile]), ALIGN[profile], TRAIN_AE[profile]
        aligned = sum(one.frame_count for one in plan.dyna)
        sequences, subjects = len(plan.dyna), len({one.subject.name for one in plan.dyna})
        first = align.first_frame_steps * sequences + align.shape_steps * subjects
        per_epoch = -(-int(0.7 * aligned) // code.batch_size)
        epochs = code.epochs + len(code.comparisons) * code.comparison_epochs
        asked = subprocess.run(
            [sys.executable, "-c", _ASK_TRAIN, profile], capture_output=True, text=True, check=True
        )
        train = json.loads(asked.stdout)
        return cls(
            aligned=aligned,
            sequences=sequences,
            subjects=subjects,
            tested=sum(round(0.6 * one.frame_count) for one in plan.held_out),
            align_steps=align.steps * aligned + first,
            autoencoder_steps=code.steps or epochs * per_epoch,
            rounds=train["rounds"],
            epochs=train["epochs"],
        )


def expected_s(
    stages: dict[str, Any], done: Work, asked: Work, step_s: float | None
) -> dict[str, float]:
    """Seconds of each stage of one seed, from those of a run that has done `done`."""
    took = {name: stage["wall_time_s"] for name, stage in stages.items()}
    aligned = asked.aligned / done.aligned
    every = (asked.aligned + asked.tested) / (done.aligned + done.tested)
    # Of known people the first sequence and those held out are predicted whole.
    predicted = asked.tested + (1 + asked.subjects) * asked.aligned / asked.sequences
    evaluated = predicted / (done.tested + (1 + done.subjects) * done.aligned / done.sequences)
    rounds = _STEPS_SHARE + (1 - _STEPS_SHARE) * aligned
    steps_s = stages["train-ae"]["measured"]["autoencoder_training_s"]
    each_s = step_s or steps_s / done.autoencoder_steps
    factors = {
        "corpus": aligned,
        "truth": every,
        "align": asked.align_steps / done.align_steps,
        "align_robust": aligned,
        "encode": aligned,
        "train": asked.epochs * asked.sequences / (done.epochs * done.sequences),
        "infer": every,
        "decode": evaluated,
        "train_plus": rounds * asked.rounds / done.rounds,
        "infer_plus": evaluated,
        "evaluate": evaluated,
    }
    expected = {name: factor * took[name] for name, factor in factors.items()}
    rest_s = (took["train-ae"] - steps_s) * aligned
    return expected | {"train-ae": each_s * asked.autoencoder_steps + rest_s}


def table(expected: dict[str, float], seeds: int) -> str:
    """Markdown: minutes of every stage, and of all, one after another."""
    times = {name: seeds if name in _AGAIN else 1 for name in expected}
    lines = ["| stage | times | minutes |", "|---|---:|---:|"]
    lines += [f"| `{n}` | {times[n]} | {times[n] * s / 60:.1f} |" for n, s in expected.items()]
    total = sum(times[name] * seconds for name, seconds in expected.items())
    return "\n".join([*lines, f"| all | | {total / 60:.0f} |"]) + "\n"


def main(config: BudgetConfig) -> None:
    """Print the table."""
    stages = json.loads(config.results.read_text(encoding="utf-8"))["stages"]
    expected = expected_s(stages, Work.of("demo"), Work.of(config.profile), config.step_s)
    sys.stdout.write(table(expected, config.seeds))


if __name__ == "__main__":
    run_as_process(BudgetConfig, main)
