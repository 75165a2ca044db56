"""`python -m benchmarks.unseen_motions --out DIR --runs RUN ...`: how DSNet errs on what is new.

Reads finished runs on synthetic data. Flesh swings at several hertz and has no offset at rest, and
a pose changes slowly. So each vertex's true and predicted offsets are split by frequency (a cosine
transform over the sequence): what is predicted slowly follows the pose, what fast is the wobble.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.fft import dct

from bridge.errors import DsnetError
from bridge.measure.metrics import ErrorSums
from bridge.motion import MotionSequence, sequences_of
from bridge.report.panels import new_figure, save_figure
from bridge.runs import Artifact, Run
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process

_PAGE = """\
# DSNet on unseen motions: what follows the pose and what swings (synthetic data)

{table}

R² of the offsets at rest against the simulation's, whose 0 is no offset (where alignment found
another shape than the true one, that counts as slow): of the offsets as they are, of what changes
more slowly than {split_hz:g} Hz, of what changes faster; and the slow part's share of the squared
error. All sequences of a motion together. Runs: {runs}. Made by `{command}`.

![Size of the offsets over time](unseen_motions.png)
"""


@dataclass
class Parts:
    """Sums over the sequences of one motion: of all, of what is slow, of what is fast."""

    split_hz: float
    whole: ErrorSums = field(default_factory=ErrorSums)
    slow: ErrorSums = field(default_factory=ErrorSums)
    fast: ErrorSums = field(default_factory=ErrorSums)

    def add(self, predicted_m: NDArray, true_m: NDArray, fps: float) -> None:
        """Take in one sequence: offsets (T, V, 3), metres."""
        self.whole.add(predicted_m, true_m)
        predicted, true = _spectrum(predicted_m), _spectrum(true_m)
        # Coefficient k of T frames turns k / 2T times a frame. The transform keeps sums of squares.
        split = math.ceil(2 * len(true_m) * self.split_hz / fps)
        self.slow.add(predicted[:split], true[:split])
        self.fast.add(predicted[split:], true[split:])

    def summary(self) -> dict[str, float]:
        """R² of each, mean error in millimetres, and the slow share of the squared error."""
        return {
            "mean_mm": self.whole.summary()["mean_mm"],
            "r2": self.whole.r2,
            "slow_r2": self.slow.r2,
            "fast_r2": self.fast.r2,
            "slow_share": self.slow.squared_error / self.whole.squared_error,
        }


def _spectrum(offsets_m: NDArray) -> NDArray:
    return np.asarray(dct(offsets_m.astype(np.float64), axis=0, norm="ortho"))


@dataclass(frozen=True)
class UnseenConfig:
    """Take the errors of unseen motions apart."""

    out: Path
    """Folder that receives unseen_motions.json, .md and .png."""
    runs: tuple[str, ...] = ("demo_robust",)
    """Runs that went as far as `decode`."""
    split_hz: float = 2.0
    """Between slow and fast: below the tissue's own frequencies, above those of most poses."""
    subject: str = "99001"
    """Whose offsets are drawn."""


def main(config: UnseenConfig) -> dict[str, Any]:
    """Write the results; also returns them.

    Raises
    ------
    DsnetError
        If a run has no truth or no unseen motions, or the first none of `subject`.
    """
    runs = {name: _Unseen(Run(name)) for name in config.runs}
    drawn = next(iter(runs.values())).of_subject(config.subject)
    results = {
        "data": "synthetic",
        "split_hz": config.split_hz,
        "predictors": next(iter(runs.values())).predictors,
        "runs": {name: run.motions(config.split_hz) for name, run in runs.items()},
        "command": ["python", "-m", "benchmarks.unseen_motions", *sys.argv[1:]],
    }
    config.out.mkdir(parents=True, exist_ok=True)
    path = config.out / "unseen_motions"
    write_text_atomically(path.with_suffix(".json"), json.dumps(results, indent=1) + "\n")
    write_text_atomically(path.with_suffix(".md"), markdown(results))
    _draw(path.with_suffix(".png"), runs, drawn)
    return results


def markdown(results: dict[str, Any]) -> str:
    """A page with one table: a row for each run and motion."""
    figures = ("R²", "slow R²", "fast R²", "slow share of the error [%]")
    names = results["predictors"]
    columns = [f"{label}: {figure}" for label in names.values() for figure in figures]
    lines = [
        f"| run | motion | true offsets [mm] | {' | '.join(columns)} |",
        "|---|---|---:" + "|---:" * len(columns) + "|",
    ]
    for run, motions in results["runs"].items():
        for motion, row in motions.items():
            cells = [cell for name in names for cell in _cells(row[name])]
            lines.append(f"| `{run}` | {motion} | {row['true_mm']:.2f} | {' | '.join(cells)} |")
    return _PAGE.format(
        table="\n".join(lines),
        split_hz=results["split_hz"],
        runs=", ".join(f"`{name}`" for name in results["runs"]),
        command=" ".join(results["command"]),
    )


def _cells(summary: dict[str, float]) -> tuple[str, ...]:
    r2 = (f"{summary[key]:.2f}" for key in ("r2", "slow_r2", "fast_r2"))
    return (*r2, f"{100 * summary['slow_share']:.0f}")


class _Unseen:
    """The unseen motions of one run, predicted and true."""

    def __init__(self, run: Run) -> None:
        self._decode, self._truth = run.artifact("decode"), run.artifact("truth")
        self.predictors: dict[str, str] = self._decode.manifest["predictors"]
        self.default: str = self._decode.manifest["default"]
        self._places = {sequence.name: sequence for sequence in sequences_of(self._decode)}
        self.sequences = [s for s in sequences_of(self._truth) if s.split == "test"]
        if not self.sequences:
            raise DsnetError(
                f"run {run.name!r} without unseen motions",
                "a run on the synthetic corpus",
                "Make one with ./reproduce.sh --run NAME.",
            )

    def of_subject(self, subject: str) -> list[MotionSequence]:
        """One person's unseen motions; DsnetError if there are none."""
        if own := [sequence for sequence in self.sequences if sequence.subject == subject]:
            return own
        known = sorted({sequence.subject for sequence in self.sequences})
        raise DsnetError(f"--subject {subject}", f"one of {', '.join(known)}", "Check its name.")

    def true_m(self, sequence: MotionSequence) -> NDArray:
        """Offsets (T, V, 3)."""
        return _frames(self._truth, "offsets", sequence)

    def predicted_m(self, predictor: str, sequence: MotionSequence) -> NDArray:
        """Offsets (T, V, 3) of one predictor."""
        return _frames(self._decode, f"offsets_{predictor}", self._places[sequence.name])

    def motions(self, split_hz: float) -> dict[str, dict[str, Any]]:
        """Errors by motion and predictor, and the mean size of the true offsets."""
        found: dict[str, dict[str, Any]] = {}
        for motion in dict.fromkeys(sequence.motion for sequence in self.sequences):
            own = [sequence for sequence in self.sequences if sequence.motion == motion]
            found[motion] = {"true_mm": 1e3 * float(np.mean([*map(self._true_size_m, own)]))}
            for name in self.predictors:
                parts = Parts(split_hz)
                for sequence in own:
                    predicted_m = self.predicted_m(name, sequence)
                    parts.add(predicted_m, self.true_m(sequence), sequence.fps)
                found[motion][name] = parts.summary()
        return found

    def _true_size_m(self, sequence: MotionSequence) -> float:
        return float(_size_m(self.true_m(sequence)).mean())


def _frames(artifact: Artifact, array: str, sequence: MotionSequence) -> NDArray:
    return np.asarray(artifact.array(array)[sequence.frames])


def _size_m(offsets_m: NDArray) -> NDArray:
    """(T,) mean length of the offsets of a frame."""
    return np.linalg.norm(offsets_m, axis=-1).mean(-1)


def _draw(path: Path, runs: dict[str, _Unseen], drawn: list[MotionSequence]) -> None:
    title = f"Size of the offsets over time, subject {drawn[0].subject}"
    figure = new_figure(4.2 * len(drawn), 3.4, title=title, origin="synthetic")
    axes = figure.subplots(1, len(drawn), squeeze=False)[0]
    truth = next(iter(runs.values()))
    for axis, sequence in zip(axes, drawn, strict=True):
        _plot(axis, truth.true_m(sequence), sequence, "truth", "black")
        for name, run in runs.items():
            for own in run.sequences:
                if own.name == sequence.name:
                    _plot(axis, run.predicted_m(run.default, own), own, name)
        axis.set(title=sequence.motion, xlabel="time [s]", ylim=(0, None))
    axes[0].set_ylabel("mean over vertices [mm]")
    axes[0].legend()
    save_figure(figure, path)


def _plot(
    axis: Axes, offsets_m: NDArray, sequence: MotionSequence, label: str, colour: str | None = None
) -> None:
    seconds = np.arange(len(offsets_m)) / sequence.fps
    axis.plot(seconds, 1e3 * _size_m(offsets_m), label=label, color=colour)


if __name__ == "__main__":
    run_as_process(UnseenConfig, main)
