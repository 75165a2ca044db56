"""`python -m benchmarks.prediction.noise --out FILE.md --runs ... --recordings DIR`: noisy input.

How a person moved behind a noisy recording nobody knows, so what is predicted from one cannot be
scored. Here it can: the test motions that we invented are clean and their flesh is known. They are
given what real recordings have faster than 8 Hz, turn by turn and joint by joint, are smoothed as
`--smooth-hz` does, and what `dsnet_plus` predicts is compared with the flesh of the clean motion.
The clean motions, smoothed alike, say what smoothing takes away. A finished run is kept, if
it has the same cutoffs.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.recorded_noise import FASTER_THAN_HZ, WHITE_DEG, WHITE_M, Noise
from benchmarks.processes import run_as_process
from bridge.errors import DsnetError, notify
from bridge.motion import Motion, MotionSequence, sequences_of, subject_rows
from bridge.motion.motion_checks import tremor_mm
from bridge.motion.resampling import continuous_rotations
from bridge.motion.sequences import is_real_motion
from bridge.motion.smoothing import StreamSmoother, smoothed
from bridge.motion.theta import pack_theta, unpack_theta
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import Model, predict_whole

_INPUTS = ("clean", "noisy", "white")
_KINDS = ("offsets", "velocity")
_HEAD = ("run", "smoothed at [Hz]", *(f"{motion}: {what}" for motion in _INPUTS
         for what in ("R²", "least R²", "velocity R²")))  # fmt: skip
_PAGE = """\
# Predictions from noisy motions (synthetic data but for the noise)

{table}

R² of what `dsnet_plus` predicts against the flesh of the clean motion, over the {clips}
invented test motions of each run; *least*: of a motion. *Noisy*: each of them with what one of
{recordings} recordings has faster than {faster:g} Hz; the noisy roots tremble by {least_mm:.1f} to
{most_mm:.1f} mm above 10 Hz (median {median_mm:.1f}), the clean ones by at most {clean_mm:.1f}.
*White*: with chance in every frame, {white_mm:g} mm and {white_deg:g} degrees along and about each
axis (root mean square). The fixed cutoff that is best for a noisy motion, and for how many of them:
{best}.
Made by `{command}`.
"""


@dataclass(frozen=True)
class NoiseConfig:
    """Write the page, and a .json beside it."""

    out: Path
    """The page, a .md; or a .json alone."""
    runs: tuple[str, ...]
    """With `truth` and `train_plus`."""
    recordings: Path
    """Folder of BVHs or AMASS files whose noise is taken."""
    cutoffs: tuple[str, ...] = ("none", "15", "12", "10", "8", "6", "5", "4", "auto")
    """At which the inputs are smoothed, in Hz; `stream`: frame by frame, by `StreamSmoother`."""


def main(config: NoiseConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If a run lacks a stage, or the folder holds no recording.
    """
    paths = sorted([*config.recordings.rglob("*.bvh"), *config.recordings.rglob("*.npz")])
    if not paths:
        raise DsnetError(
            f"--recordings {config.recordings} without .bvh or .npz", "some", "Check the path."
        )
    noises = [Noise.of(path) for path in paths]
    path = config.out.with_suffix(".json")
    kept = json.loads(path.read_text(encoding="utf-8"))["runs"] if path.exists() else {}
    kept = {n: clips for n, clips in kept.items() if [*clips[0]["scores"]] == [*config.cutoffs]}
    found = {
        name: kept.get(name) or list(_clips(Run(name), noises, config.cutoffs))
        for name in config.runs
    }
    result = {
        "runs": found,
        "recordings": len(paths),
        "command": " ".join(["python", "-m", "benchmarks.prediction.noise", *sys.argv[1:]]),
    }
    write_text_atomically(path, json.dumps(result, indent=1) + "\n")
    if config.out != path:
        write_text_atomically(config.out, markdown(path))


def markdown(path: Path) -> str:
    """The page of a .json."""
    result = json.loads(path.read_text(encoding="utf-8"))
    lines = ["| " + " | ".join(_HEAD) + " |", "|---" + "|---:" * (len(_HEAD) - 1) + "|"]
    for run, clips in result["runs"].items():
        for cutoff in clips[0]["scores"]:
            cells = [cell for motion in _INPUTS for cell in _cells(clips, cutoff, motion)]
            lines.append("| " + " | ".join([f"`{run}`", cutoff, *cells]) + " |")
    clips = [clip for found in result["runs"].values() for clip in found]
    noisy_mm = [clip["tremor_mm"]["noisy"] for clip in clips]
    return _PAGE.format(
        table="\n".join(lines),
        clips=" and ".join(sorted({str(len(found)) for found in result["runs"].values()})),
        recordings=result["recordings"],
        faster=FASTER_THAN_HZ,
        least_mm=min(noisy_mm),
        most_mm=max(noisy_mm),
        median_mm=float(np.median(noisy_mm)),
        clean_mm=max(clip["tremor_mm"]["clean"] for clip in clips),
        best=_best_cutoffs(clips),
        white_mm=1e3 * WHITE_M,
        white_deg=WHITE_DEG,
        command=result["command"],
    )


def streams_table(path: Path) -> str:
    """Of the first run of a .json: R² of offsets, and of their velocity, by cutoff and input."""
    (clips, *_) = json.loads(path.read_text(encoding="utf-8"))["runs"].values()
    lines = ["| smoothed | clean | noisy | white |", "|---|---:|---:|---:|"]
    for cutoff in clips[0]["scores"]:
        cells = (_cells(clips, cutoff, motion) for motion in _INPUTS)
        lines.append(f"| {cutoff} | " + " | ".join(f"{r2}, {v}" for r2, _, v in cells) + " |")
    return "\n".join(lines)


def _cells(clips: Sequence[Mapping[str, Any]], cutoff: str, motion: str) -> list[str]:
    scores = [clip["scores"][cutoff][motion] for clip in clips]
    missed, whole = (
        {kind: sum(score[kind][part] for score in scores) for kind in _KINDS} for part in (0, 1)
    )
    least = min(1 - score["offsets"][0] / score["offsets"][1] for score in scores)
    r2s = {kind: 1 - missed[kind] / whole[kind] for kind in _KINDS}
    return [f"{r2s['offsets']:.3f}", f"{least:.3f}", f"{r2s['velocity']:.3f}"]


def _best_cutoffs(clips: Sequence[Mapping[str, Any]]) -> str:
    """How many noisy motions each fixed cutoff is the best for, over all runs."""
    best = Counter(
        min(fixed, key=lambda cutoff: clip["scores"][cutoff]["noisy"]["offsets"][0])
        for clip in clips
        for fixed in [[cutoff for cutoff in clip["scores"] if cutoff != "auto"]]
    )
    return ", ".join(f"{cutoff}: {best[cutoff]}" for cutoff in clips[0]["scores"] if best[cutoff])


def _clips(run: Run, noises: Sequence[Noise], cutoffs: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Energies missed and there, of every invented test motion, cutoff and input."""
    truth, model = run.artifact("truth"), load_model(run, "dsnet_plus").model
    sequences = sequences_of(truth)
    rows = subject_rows(sequences)
    tested = [s for s in sequences if s.split == "test" and not is_real_motion(s.name)]
    for number, sequence in enumerate(tested):
        notify(f"{run.name}: {sequence.name}")
        pose, trans_m = unpack_theta(np.asarray(truth.array("theta")[sequence.frames], np.float64))
        betas = np.asarray(truth.array("betas")[rows[sequence.subject]], np.float64)
        noise = noises[number % len(noises)]
        white = Noise.white(len(pose), seed=number)
        inputs = {
            "clean": (pose, trans_m),
            "noisy": noise.added(pose, trans_m),
            "white": white.added(pose, trans_m),
        }
        stored = {name: _stored(p, m, sequence.fps) for name, (p, m) in inputs.items()}
        yield {
            "name": sequence.name,
            "tremor_mm": {name: round(tremor_mm(one.trans_m, one.fps), 3)
                          for name, one in stored.items()},
            "scores": {
                cutoff: {
                    name: _energies(model, _smoothed(one, cutoff), betas, truth, sequence)
                    for name, one in stored.items()
                }
                for cutoff in cutoffs
            },
        }  # fmt: skip


def _stored(pose: NDArray, trans_m: NDArray, fps: float) -> Motion:
    theta = pack_theta(pose, trans_m)
    return Motion(theta, np.zeros(10), "unknown", fps, fps, Path(), up="z")


def _smoothed(stored: Motion, cutoff: str) -> NDArray:
    """Its theta (T, 69)."""
    if cutoff == "stream":
        smoother = StreamSmoother(stored.fps)
        given = [smoother.push(theta) for theta in stored.theta]
        return np.stack([*(theta for theta in given if theta is not None), *smoother.finish()])
    if cutoff != "none":
        stored = smoothed(stored, "auto" if cutoff == "auto" else float(cutoff))
    return pack_theta(continuous_rotations(stored.pose), stored.trans_m)


def _energies(
    model: Model,
    theta: NDArray,
    betas: NDArray,
    truth: Artifact,
    sequence: MotionSequence,
) -> dict[str, list[float]]:
    """By kind, the sums of squares of what is missed and of what there is."""
    found = np.concatenate(list(predict_whole(model, theta, betas).offsets_m)).astype(np.float64)
    there = np.asarray(truth.array("offsets")[sequence.frames], np.float64)
    parts = {
        "offsets": (found, there),
        "velocity": (np.diff(found, axis=0), np.diff(there, axis=0)),
    }
    return {
        kind: [float(np.square(a - b).sum()), float(np.square(b).sum())]
        for kind, (a, b) in parts.items()
    }


if __name__ == "__main__":
    run_as_process(NoiseConfig, main)
