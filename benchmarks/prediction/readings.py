"""`python -m benchmarks.prediction.readings --out FILE.json --runs ...`: one law, read twice.

Simulated tissue follows accelerations, and poses at 60 frames a second do not say what they are:
the second law takes a parabola through five frames, `dsnet_plus` differences of three. Of a smooth
motion both say the same. What is faster than some 10 Hz, as the noise of a recording is, they weigh
differently. So every test motion is simulated again by the same law with parabolas through three
frames, and compared with the truth like a prediction: what it misses is not the tissue's. What is
finished is kept.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.laws.second_tissue_simulation import PARABOLA_FRAMES, SecondTissueSimulator
from benchmarks.processes import run_as_process
from bridge.body import load_body_model
from bridge.errors import DsnetError
from bridge.measure.metrics import ErrorSums
from bridge.motion import MotionSequence, sequences_of, subject_rows
from bridge.motion.sequences import is_real_motion
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically

FRAMES = 3
_PEOPLE = ("known person", "new person")
_KINDS = {False: "invented", True: "recorded"}
_HEAD = ("run", "motions", "who", "clips", f"the law itself, {FRAMES} frames", "least",
         "`dsnet_plus`", "least")  # fmt: skip
_NOTE = """\
{table}

R² of the second law's offsets: medians over the test motions of a run, and the least. *The law
itself* is simulated again with accelerations from parabolas through {frames} frames in place of
{own}; nothing else is changed. Made by `{command}`.
"""


@dataclass(frozen=True)
class ReadingsConfig:
    """Write a .json, which `benchmarks.prediction.recordings` tabulates."""

    out: Path
    """The .json."""
    runs: tuple[str, ...]
    """Of the test bed under the second law, finished up to `evaluate`."""


def main(config: ReadingsConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If the run lacks a stage, or is of another law or form.
    """
    path = config.out
    kept = json.loads(path.read_text(encoding="utf-8"))["runs"] if path.exists() else {}
    result = {
        "runs": {name: kept.get(name) or list(_clips(Run(name))) for name in config.runs},
        "command": " ".join(["python", "-m", "benchmarks.prediction.readings", *sys.argv[1:]]),
    }
    write_text_atomically(path, json.dumps(result, indent=1) + "\n")


def markdown(path: Path) -> str:
    """The table of a .json, and what it says."""
    result = json.loads(path.read_text(encoding="utf-8"))
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" * 3 + "|---:" * (len(_HEAD) - 3) + "|"]
    for run, clips in result["runs"].items():
        lines += ["| " + " | ".join([f"`{run}`", *row]) + " |" for row in _rows(clips)]
    return _NOTE.format(
        table="\n".join(lines),
        frames=FRAMES,
        own=PARABOLA_FRAMES,
        command=result["command"],
    )


def _rows(clips: Sequence[Mapping[str, Any]]) -> Iterator[list[str]]:
    for recorded, kind in _KINDS.items():
        for who in _PEOPLE:
            own = [
                clip
                for clip in clips
                if is_real_motion(clip["name"]) == recorded
                and clip["cell"].startswith(who.replace(" ", "_"))
            ]
            if own:
                found = [[clip[of] for clip in own] for of in ("read_otherwise", "dsnet_plus")]
                figures = [f"{of(r2s):.3f}" for r2s in found for of in (median, min)]
                yield [kind, who, str(len(own)), *figures]


def _clips(run: Run) -> Iterator[dict[str, Any]]:
    truth, evaluated = run.artifact("truth"), run.artifact("evaluate")
    bed = evaluated.manifest["test_bed"]
    if bed["tissue"] != "second" or bed["form"] != "clean":
        raise DsnetError(
            f"run {run.name!r} of law {bed['tissue']!r}, form {bed['form']!r}",
            "law 'second', form 'clean'",
            "Name a run of dsnet corpus --tissue second.",
        )
    scored = {score["name"]: score for score in evaluated.manifest["per_sequence"]}
    sequences = sequences_of(truth)
    body = load_body_model(f"embedded:{bed['gender']}")
    rows = subject_rows(sequences)
    for sequence in sequences:
        score = scored.get(sequence.name)
        if sequence.split == "test" and score is not None:
            betas = np.asarray(truth.array("betas")[rows[sequence.subject]], np.float64)
            again = SecondTissueSimulator(body, betas, parabola_frames=FRAMES)
            yield {
                "name": sequence.name,
                "cell": score["cell"],
                "read_otherwise": round(_r2_of(again, truth, sequence), 4),
                "dsnet_plus": round(score["errors"]["dsnet_plus"]["offsets"]["r2"], 4),
            }


def _r2_of(again: SecondTissueSimulator, truth: Artifact, sequence: MotionSequence) -> float:
    theta = np.asarray(truth.array("theta")[sequence.frames], np.float64)
    sums = ErrorSums()
    sums.add(again.offsets(theta, sequence.fps), truth.array("offsets")[sequence.frames])
    return sums.r2


if __name__ == "__main__":
    run_as_process(ReadingsConfig, main)
