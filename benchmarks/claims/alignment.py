"""`python -m benchmarks.claims.alignment --out FILE`: what the paper says of its data and of gains.

Of a finished run: how far a gain on predictions makes up for what the pose absorbed (Section 6),
how much more spine2 turns in the fitted poses than in the true ones (Figure 10), and how the error
is spread along the held-out clip (Figure 8).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import run_as_process
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.motion import unpack_theta
from bridge.motion.splits import CELLS
from bridge.paper import ABSORBING_JOINT, ABSORBING_SEQUENCE
from bridge.runs import Artifact, Run
from bridge.runs.files import write_text_atomically
from dsnet.evaluation.evaluation import MESH_ERROR, per_frame_m
from dsnet.evaluation.pipelines import SMPL, MotionArrays, Pipeline, pipelines_of

GAINS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)
"""By which predicted offsets are multiplied."""
_CHUNK = 64
_PARTS = 4


@dataclass(frozen=True)
class AlignmentConfig:
    """Measure a finished run of both pipelines, whose truth is known."""

    out: Path
    """JSON file to write."""
    run: str = "demo"
    """Name of the run."""


def main(config: AlignmentConfig) -> dict[str, Any]:
    """Write the results; also returns them."""
    run = Run(config.run)
    stages = run.artifacts("truth", "align", "infer", "decode", "infer_plus", "evaluate",
                           "align_robust")  # fmt: skip
    truth, pipelines = MotionArrays.of(stages["truth"]), pipelines_of(stages)
    results = {
        "command": " ".join(["python", "-m", "benchmarks.claims.alignment", *sys.argv[1:]]),
        "run": config.run,
        "true_mm": _true_mm(stages["evaluate"]),
        "gains": _gains_of_all(pipelines, truth, stages["evaluate"]),
        "joint": _turning(pipelines, truth),
        "along_the_clip": _along_the_clip(stages["evaluate"]),
    }
    config.out.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out, json.dumps(results, indent=1, allow_nan=False) + "\n")
    return results


def _true_mm(evaluate: Artifact) -> float:
    """Root mean square of the true offsets of one test group, which tells runs' data apart."""
    alone = evaluate.manifest["cells"]["known_person_known_motion"][SMPL]
    return round(alone["offsets"]["rms_mm"], 4)


def _gains_of_all(
    pipelines: Iterable[Pipeline], truth: MotionArrays, evaluate: Artifact
) -> dict[str, dict[str, Any]]:
    """By predictor or alignment, and by test group: R2 against the true offsets at each gain."""
    cells = {one["name"]: one["cell"] for one in evaluate.manifest["per_sequence"]}
    shown = {
        cell: [name for name, own in cells.items() if own == cell]
        for cell in ("validation", *CELLS)
    }
    found: dict[str, dict[str, Any]] = {}
    for pipeline in pipelines:
        aligned = [one.name for one in pipeline.align.sequences.values() if one.split == "train"]
        found[pipeline.alignment] = {
            "train": _gains(pipeline.align, "offsets", aligned, truth),
            "validation": _gains(pipeline.align, "offsets", shown["validation"], truth),
        }
        for name in pipeline.predictors:
            found[name] = {
                cell: _gains(pipeline.offsets, f"offsets_{name}", names, truth)
                for cell, names in shown.items()
                if names
            }
    return found


def _gains(
    given: MotionArrays, array: str, names: Iterable[str], truth: MotionArrays
) -> dict[str, Any]:
    own = mixed = true = 0.0
    for name in names:
        length = given.sequences[name].length
        for start in range(0, length, _CHUNK):
            part = slice(start, min(start + _CHUNK, length))
            predicted = np.float64(given.frames(array, name, part))
            wanted = np.float64(truth.frames("offsets", name, part))
            own += float(np.square(predicted).sum())
            mixed += float((predicted * wanted).sum())
            true += float(np.square(wanted).sum())
    best = mixed / own
    return {
        "r2": {f"{gain:g}": round(_r2(gain, own, mixed, true), 5) for gain in GAINS},
        "best_gain": round(best, 4),
        "best_r2": round(_r2(best, own, mixed, true), 5),
    }


def _r2(gain: float, own: float, mixed: float, true: float) -> float:
    """Of predictions times a gain; sums of squares of predicted, of products, of true offsets."""
    return (2 * gain * mixed - gain**2 * own) / true


def _turning(pipelines: Iterable[Pipeline], truth: MotionArrays) -> dict[str, Any]:
    """How far one joint swings about its mean turn in one motion, degrees, root mean square."""
    motion = ABSORBING_SEQUENCE.partition("_")[2]
    found: dict[str, list[NDArray]] = {}
    for pipeline in pipelines:
        names = [n for n, one in pipeline.align.sequences.items() if one.motion == motion]
        arrays: Mapping[str, MotionArrays] = {"truth": truth, pipeline.alignment: pipeline.align}
        for label, poses in arrays.items():
            found[label] = [_turn_deg(poses, name) for name in names]
    return {
        "joint": ABSORBING_JOINT,
        "motion": motion,
        "swing_deg": {
            label: [round(float(np.sqrt(turn.var(axis=0).sum())), 3) for turn in turns]
            for label, turns in found.items()
        },
    }


def _turn_deg(poses: MotionArrays, name: str) -> NDArray[np.float64]:
    """(T, 3) rotation vector of the joint."""
    pose, _ = unpack_theta(poses.frames("theta", name, slice(None)))
    return np.degrees(pose[:, SMPL_JOINT_NAMES.index(ABSORBING_JOINT)].astype(np.float64))


def _along_the_clip(evaluate: Artifact) -> dict[str, Any]:
    """Of the held-out clip's mean error in each frame, millimetres."""
    clip = next(s for s in evaluate.manifest["per_sequence"] if s["split"] == "validation")
    smpl_m = per_frame_m(evaluate, MESH_ERROR, SMPL, clip["name"])
    found: dict[str, Any] = {}
    for name in evaluate.manifest["predictors"]:
        error_m = per_frame_m(evaluate, MESH_ERROR, name, clip["name"])
        if error_m is not None and smpl_m is not None:
            error_mm = 1e3 * error_m.astype(np.float64)
            found[name] = {
                "least_mm": round(float(error_mm.min()), 3),
                "most_mm": round(float(error_mm.max()), 3),
                "quarters_mm": [
                    round(float(p.mean()), 3) for p in np.array_split(error_mm, _PARTS)
                ],
                "variation": round(float(error_mm.std() / error_mm.mean()), 3),
                "with_smpl_error": round(float(np.corrcoef(error_mm, smpl_m)[0, 1]), 3),
            }
    return {"clip": clip["name"], "predictors": found}


if __name__ == "__main__":
    run_as_process(AlignmentConfig, main)
