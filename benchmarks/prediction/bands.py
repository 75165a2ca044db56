"""`python -m benchmarks.prediction.bands --run RUN --out FILE.json`: errors by frequency.

Of a finished run of the test bed with real motions. Each unseen motion's true and predicted offsets
are windowed (Hann) and transformed over time; energies are summed over vertices and motions, for
invented and recorded motions apart. Motions with pops are left out: most energy would be theirs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from bridge.motion import Motion, MotionSequence, sequences_of
from bridge.motion.motion_checks import find_pops
from bridge.motion.sequences import is_real_motion
from bridge.paper import N_BETAS
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically

EDGES_HZ = (0, 2, 4, 6, 9, 12, 16, 22, 30)
_SHORTEST = 120
_KINDS = {"invented": False, "recorded": True}
_NOTE = """\
{table}

Run `{run}`, `dsnet_plus`, test motions of two seconds and more without pops. *Share*: of the true
offsets' energy. R²: 1 less the error's energy over the true one's. *Gain*: amplitude of the
prediction over the truth's. Made by `{command}`.
"""


@dataclass(frozen=True)
class BandsConfig:
    """Write a .json, which `benchmarks.prediction.recordings` tabulates."""

    run: str
    """A run of the test bed, finished up to `infer`."""
    out: Path
    """The .json."""


def main(config: BandsConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If the run lacks a stage.
    """
    energies = {kind: energies_of(Run(config.run), real) for kind, real in _KINDS.items()}
    found = {kind: [dict(row) for row in _bands(energy)] for kind, energy in energies.items()}
    result = {
        "run": config.run,
        "edges_hz": EDGES_HZ,
        "bands": found,
        "command": " ".join(["python", "-m", "benchmarks.prediction.bands", *sys.argv[1:]]),
    }
    write_text_atomically(config.out, json.dumps(result, indent=1) + "\n")


def markdown(path: Path) -> str:
    """The table of a .json, and what it says."""
    result = json.loads(path.read_text(encoding="utf-8"))
    edges = [f"{low} to {high}" for low, high in pairwise(EDGES_HZ)]
    head = ["Hz", *(f"{kind}: {what}" for kind in _KINDS for what in ("share", "R²", "gain"))]
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    for number, edge in enumerate(edges):
        bands = [result["bands"][kind][number] for kind in _KINDS]
        cells = [f"{b['share']:.3f} | {b['r2']:.2f} | {b['gain']:.2f}" for b in bands]
        lines.append(f"| {edge} | {' | '.join(cells)} |")
    return _NOTE.format(table="\n".join(lines), run=result["run"], command=result["command"])


def energies_of(run: Run, real: bool) -> NDArray[np.float64]:
    """(3, bands) of the truth, the error and the prediction, over the run's test motions."""
    truth, predicted = run.artifact("truth"), run.artifact("infer_plus")
    places = {sequence.name: sequence for sequence in sequences_of(predicted)}
    total = np.zeros((3, len(EDGES_HZ) - 1))
    for sequence in sequences_of(truth):
        wanted = sequence.split == "test" and is_real_motion(sequence.name) == real
        if wanted and sequence.length >= _SHORTEST and not _pops(truth, sequence):
            true_m = np.asarray(truth.array("offsets")[sequence.frames], np.float64)
            other = predicted.array("offsets_dsnet_plus")[places[sequence.name].frames]
            total += band_energies(true_m, np.asarray(other, np.float64), sequence)
    return total


def _pops(truth: Artifact, sequence: MotionSequence) -> bool:
    theta = np.asarray(truth.array("theta")[sequence.frames], np.float64)
    source, whole = Path(sequence.name), [slice(0, len(theta))]
    motion = Motion(theta, np.zeros(N_BETAS), "unknown", sequence.fps, sequence.fps, source)
    return bool(find_pops(motion, whole))


def band_energies(
    true_m: NDArray[np.float64], predicted_m: NDArray[np.float64], sequence: MotionSequence
) -> NDArray[np.float64]:
    """(3, bands) of one motion's offsets (T, V, 3)."""
    window = np.hanning(len(true_m))[:, None, None]
    hz = np.fft.rfftfreq(len(true_m), 1 / sequence.fps)
    band = np.digitize(hz, EDGES_HZ[1:-1])
    found = []
    for values in (true_m, predicted_m - true_m, predicted_m):
        energy = np.abs(np.fft.rfft(window * (values - values.mean(axis=0)), axis=0)) ** 2
        found.append(np.bincount(band, energy.sum(axis=(1, 2)), len(EDGES_HZ) - 1))
    return np.stack(found)


def _bands(energy: NDArray[np.float64]) -> Iterator[dict[str, float]]:
    whole = energy[0].sum()
    for true, error, predicted in energy.T:
        yield {
            "share": round(true / whole, 5),
            "r2": round(1 - error / true, 4),
            "gain": round(float(np.sqrt(predicted / true)), 4),
        }


if __name__ == "__main__":
    run_as_process(BandsConfig, main)
