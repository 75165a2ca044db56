"""`python -m benchmarks.skin_markers.recovery --out FILE`: what fits find of flesh that is known.

Women of random shapes and random constants of the chest jump, run and hop; their markers have noise
and gaps. Each is fitted with the true pose, with a pose that swallowed part of the bounce and is
taken for true, and as `dsnet train --markers` does it, by markers on bone.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from benchmarks.skin_markers.truth import Flesh, flesh_model, packaged, write_recording
from bridge.body import BodyModelData
from bridge.runs.workers import worker_pool
from bridge.tissue.trained_plus import NAME, TrainedPlus
from dsnet.fitting import recording
from dsnet.fitting.fit import Estimate, fit_subject
from dsnet.fitting.population import combine
from dsnet.fitting.tissue_patch import Region, constants_of, logit, preload_of
from dsnet.markers.registration import SOFT, SPOTS
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import PlusModel
from dsnet.synthetic.motions import perform
from dsnet.synthetic.motions.posing import Skeleton
from dsnet.synthetic.tissue_parameters import SOFT_TISSUE, WAVE_SPEED_M_S

TAKES = ("jumping_jacks", "running_on_spot", "one_leg_jump")
MODES = ("true pose", "a pose that swallowed flesh", "the same, by markers on bone")
_NINETY = 1.645
_CHEST_ONLY = ("LBUST", "RBUSTLO")


@dataclass(frozen=True)
class RecoveryConfig:
    """Fit, and tabulate errors."""

    out: Path
    """JSON file of results."""
    people: int = 5
    """How many."""
    frames: int = 240
    """Of each take, at 60 fps."""
    seed: int = 0
    """Of shapes, constants and noise."""


def base_model(body: BodyModelData) -> TrainedPlus:
    """The packaged model with the law's constants, which is what fits begin with."""
    model = packaged(body.gender)
    base = dict(model.weights.base)
    base["wave_speed"] = np.full_like(base["wave_speed"], np.log(WAVE_SPEED_M_S))
    model = replace(model, weights=replace(model.weights, base=base))
    parts = {
        part: Flesh(SOFT_TISSUE[part].frequency_hz, SOFT_TISSUE[part].damping_ratio, 1.8)
        for part in SOFT
    }
    return flesh_model(body, model, parts)


def main(config: RecoveryConfig) -> None:
    """Run it."""
    body = load_model(None, NAME, "female").body
    with worker_pool("processes", (body, base_model(body), config)) as pool:
        found = [*pool.map(one_woman, range(config.people))]
    results = {
        mode: _errors([truth for truth, _ in found], [fits[mode] for _, fits in found])
        for mode in MODES
    }
    stored = {**asdict(config), "out": None, "takes": TAKES, "chest": results}
    config.out.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    print(table(stored))


def table(stored: dict[str, Any]) -> str:
    """Markdown, as docs/markers.md has it."""
    lines = [
        "| fitted with | frequency off | damping off | preload off | 90 % intervals that hold |\n",
        "|---|---:|---:|---:|---:|\n",
    ]
    for mode, one in stored["chest"].items():
        frequency, damping, preload = one["median"]
        held = 100 * float(np.mean(one["held"]))
        lines.append(
            f"| {mode} | {100 * frequency:.0f} % | {100 * damping:.0f} % | {preload:.2f} "
            f"| {held:.0f} % |\n"
        )
    return "".join(lines)


def one_woman(
    tools: tuple[BodyModelData, TrainedPlus, RecoveryConfig], number: int
) -> tuple[list[float], dict[str, Estimate]]:
    """Her true (Hz, damping ratio, preload), and what fits find."""
    body, base, config = tools
    rng = np.random.default_rng([config.seed, number])
    betas = 0.8 * rng.standard_normal(10)
    template = Flesh(
        SOFT_TISSUE["chest"].frequency_hz * np.exp(0.2 * rng.standard_normal()),
        0.24 * np.exp(0.3 * rng.standard_normal()),
        rng.uniform(1.2, 2.3),
    )
    true = flesh_model(body, base, {"chest": template})
    region, hers = Region.of(body, base, "chest"), constants_of(body, true, betas)
    truth = [
        float(np.exp(region.typical @ np.log(hers["omega"])) / (2 * np.pi)),
        template.damping_ratio,
        template.preload,
    ]
    fits = {}
    with tempfile.TemporaryDirectory() as folder:
        for mode in MODES:
            files = [Path(folder) / f"{mode}_{take}.npz" for take in TAKES]
            for file, take in zip(files, TAKES, strict=True):
                theta = perform(take, f"woman {number}", Skeleton(body, betas),
                                frame_count=config.frames, fps=60, seed=config.seed)  # fmt: skip
                write_recording(
                    file, PlusModel(true, body), body, betas, theta, rng, mode != MODES[0]
                )
            with_bone: Callable = recording.bone_motion
            try:
                if mode != MODES[2]:
                    recording.bone_motion = lambda body, motion, *_: motion
                read = [_chest_alone(recording.read_recording(file, body)) for file in files]
                fits[mode] = fit_subject(body, base, read)["chest"]
            finally:
                recording.bone_motion = with_bone
    return truth, fits


def _chest_alone(one: recording.Recording) -> recording.Recording:
    """Without the other soft markers."""
    soft = {label for label, spot in SPOTS.items() if spot.flesh}
    vertices = {
        label: vertex
        for label, vertex in one.registered.vertices.items()
        if label not in soft or label in _CHEST_ONLY
    }
    return replace(one, registered=replace(one.registered, vertices=vertices))


def _errors(truths: list[list[float]], estimates: list[Estimate]) -> dict:
    """Of each woman and in the middle: frequency and damping in parts of them, and preload; how
    often intervals hold the truth."""
    shared = combine("chest", estimates)
    rows, held = [], []
    for truth, one, own, sd in zip(truths, estimates, shared.own, shared.own_sd, strict=True):
        true = np.array([*(np.log(truth[:2]) - one.base) / one.reach, float(logit(truth[2]))])
        off: NDArray = np.array(own) - true
        held.append((np.abs(off) < _NINETY * np.array(sd)).tolist())
        found = [*np.exp(one.base + one.reach * np.array(own[:2])), float(preload_of(own[2]))]
        rows.append({"truth": _rounded(truth), "found": _rounded(found), "held": held[-1]})
    truth, found = (np.array([row[key] for row in rows]) for key in ("truth", "found"))
    off = found - truth
    off[:, :2] /= truth[:, :2]
    return {
        "median": _rounded(np.median(np.abs(off), axis=0)),
        "mean": _rounded(off.mean(axis=0)),
        "held": _rounded(np.mean(held, axis=0)),
        "women": rows,
    }


def _rounded(values: NDArray | list[float]) -> list[float]:
    return [round(float(value), 3) for value in values]


if __name__ == "__main__":
    main(tyro.cli(RecoveryConfig))
