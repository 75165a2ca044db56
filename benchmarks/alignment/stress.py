"""`python -m benchmarks.alignment.stress --out DIR`: the robust aligner where its law fails.

The robust aligner explains displacements by accelerations, and the simulator's tissue obeys such
a law nearly. So this breaks the law, one assumption at a time, and the meshes too: tissue that is
thick as honey, tied to its neighbours or stiffens early; scanner noise; a person whose shape the
model does not hold. Beside it stand the same aligner without the law (vertices weighted by how
little they jiggle), plain Gauss-Newton (all alike), and what the true pose would give.

Writes DIR/stress.json and stress.md. Six minutes on two cores, 1 GB.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.alignment.lesser_laws import AllAlike, WeightsAlone
from bridge.body import load_body_model
from bridge.measure.metrics import rotation_error_deg
from bridge.motion import unpack_theta
from bridge.runs.folders import write_text_atomically
from bridge.runs.processes import run_as_process
from bridge.runs.provenance import provenance
from torch_align_ae.alignment.robust import RobustSettings, align_sequences
from torch_align_ae.alignment.robust.loads import Loads
from torch_align_ae.body import SMPL, rest_pose_offsets
from torch_align_ae.corpus.dyna_files import FPS
from torch_align_ae.corpus.motions import Skeleton, perform
from torch_align_ae.corpus.simulation import TissueSimulator, body_in_double, posed_meshes
from torch_align_ae.corpus.subjects import SUBJECTS, Subject
from torch_align_ae.corpus.tissue_parameters import (
    TissueParameters,
    smooth_over_surface,
    tissue_parameters,
)

_SUBJECTS = (SUBJECTS["female"][0], SUBJECTS["female"][3])
_MOTIONS = ("one_leg_jump", "shake_hips")
ALIGNERS: dict[str, type[Loads] | None] = {
    "true pose": None,
    "robust": Loads,
    "weights alone": WeightsAlone,
    "all alike": AllAlike,
}
"""By the law that each takes out."""

Array = NDArray[np.floating]


@dataclass(frozen=True)
class StressConfig:
    """Break the robust aligner's assumptions one by one."""

    out: Path
    """Folder that receives the results."""
    frames: int = 120
    """Length of each of the four sequences of a condition."""
    seed: int = 0
    """Seed of motions, noise and shapes."""


@dataclass(frozen=True)
class Condition:
    """How the meshes differ from the corpus's."""

    title: str
    tissue: Callable[[TissueParameters], TissueParameters] = lambda tissue: tissue
    noise_m: float = 0.0
    """Standard deviation of each coordinate of each frame."""
    foreign_shape_m: float = 0.0
    """Root mean square of a smooth displacement that is the subject's own and not in the model."""


def _scaled(**factors: float) -> Callable[[TissueParameters], TissueParameters]:
    return lambda tissue: replace(
        tissue, **{name: getattr(tissue, name) * factor for name, factor in factors.items()}
    )


CONDITIONS = (
    Condition("as simulated"),
    Condition("damping x 4", _scaled(damping_ratio=4)),
    Condition("coupling x 3", _scaled(wave_speed_m_s=3)),
    Condition("stiffening x 10", _scaled(stiffening_per_m2=10)),
    Condition("noise 0.1 mm", noise_m=1e-4),
    Condition("noise 0.3 mm", noise_m=3e-4),
    Condition("noise 1 mm", noise_m=1e-3),
    Condition("foreign shape 3 mm", foreign_shape_m=3e-3),
)


def main(config: StressConfig) -> None:
    """Measure every condition and write the results."""
    started, results = time.perf_counter(), []
    for condition in tqdm(CONDITIONS, desc="stress", unit="condition", disable=None):
        takes = list(_takes(condition, config))
        scores = {name: _score(takes, settings) for name, settings in ALIGNERS.items()}
        results.append({"condition": condition.title, "aligners": scores})
    found = {
        "data": "synthetic",
        "conditions": results,
        "provenance": {
            **provenance(time.perf_counter() - started),
            "frames": config.frames,
            "seed": config.seed,
        },
    }
    config.out.mkdir(parents=True, exist_ok=True)
    write_text_atomically(config.out / "stress.json", json.dumps(found, indent=1) + "\n")
    write_text_atomically(config.out / "stress.md", _markdown(found))


@dataclass(frozen=True)
class _Take:
    subject: int
    meshes_m: NDArray[np.float32]
    theta: NDArray[np.float32]
    offsets_m: Array


def _takes(condition: Condition, config: StressConfig) -> Iterator[_Take]:
    smpl = body_in_double(load_body_model("embedded:female"))
    rng = np.random.default_rng(config.seed)
    for row, subject in enumerate(_SUBJECTS):
        parameters = condition.tissue(tissue_parameters(smpl.data, subject.betas))
        simulator = TissueSimulator(smpl, subject.betas, parameters)
        foreign_m = condition.foreign_shape_m * _smooth_field(smpl, subject, rng)
        for motion in _MOTIONS:
            theta = _perform(smpl, subject, motion, config)
            offsets_m = simulator.offsets(theta.astype(np.float64), FPS) + foreign_m
            meshes_m = posed_meshes(smpl, subject.betas, theta.astype(np.float64), offsets_m)
            noise_m = condition.noise_m * rng.standard_normal(meshes_m.shape)
            yield _Take(row, (meshes_m + noise_m).astype(np.float32), theta, offsets_m)


def _perform(
    smpl: SMPL, subject: Subject, motion: str, config: StressConfig
) -> NDArray[np.float32]:
    skeleton = Skeleton.of(smpl.data, subject.betas)
    frames, seed = config.frames, config.seed
    theta = perform(motion, subject.name, skeleton, frame_count=frames, fps=FPS, seed=seed)
    return theta.astype(np.float32)


def _smooth_field(smpl: SMPL, subject: Subject, rng: np.random.Generator) -> Array:
    """(V, 3) random displacement that varies over a decimetre, of unit root mean square."""
    vertices = smpl.rest(torch.from_numpy(subject.betas[None]))[0][0].numpy()
    rough = rng.standard_normal(vertices.shape)
    smooth = smooth_over_surface(rough, vertices, smpl.data.faces, length_m=0.1)
    return smooth / np.sqrt(np.square(smooth).sum(1).mean())


def _score(takes: list[_Take], law: type[Loads] | None) -> dict[str, float]:
    """R2 of the offsets' change over time, and mean pose error; without a law of the truth."""
    smpl = SMPL(load_body_model("embedded:female"))
    if law is None:
        betas = np.stack([subject.betas for subject in _SUBJECTS]).astype(np.float32)
        thetas = [take.theta for take in takes]
    else:
        meshes = [take.meshes_m for take in takes]
        subjects = [take.subject for take in takes]
        betas, thetas = align_sequences(smpl, meshes, subjects, RobustSettings(), law=law)
    wrong = right = 0.0
    angles_deg = []
    for take, theta in zip(takes, thetas, strict=True):
        pose, trans = (torch.from_numpy(part.copy()) for part in unpack_theta(theta))
        shapes = torch.from_numpy(betas[take.subject]).expand(len(theta), -1)
        with torch.inference_mode():
            found, _ = rest_pose_offsets(smpl, torch.from_numpy(take.meshes_m), shapes, pose, trans)
        true_m, found_m = _changes(take.offsets_m), _changes(found.numpy())
        wrong += float(np.square(found_m - true_m).sum())
        right += float(np.square(true_m).sum())
        angles_deg.append(rotation_error_deg(unpack_theta(theta)[0], unpack_theta(take.theta)[0]))
    return {"r2": 1 - wrong / right, "pose_deg": float(np.mean(np.concatenate(angles_deg)))}


def _changes(offsets_m: Array) -> Array:
    return offsets_m - offsets_m.mean(axis=0)


def _markdown(found: dict[str, Any]) -> str:
    names = list(ALIGNERS)
    lines = [
        "# The robust aligner where its assumptions fail (synthetic data)",
        "",
        "| meshes | " + " | ".join(f"{name}: R² | pose [deg]" for name in names) + " |",
        "|---|" + "---:|" * (2 * len(names)),
    ]
    for row in found["conditions"]:
        cells = [
            f"{row['aligners'][name]['r2']:.3f} | {row['aligners'][name]['pose_deg']:.2f}"
            for name in names
        ]
        lines.append(f"| {row['condition']} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "R² is that of the offsets' change over time against the simulated truth; a noisy mesh's",
        "own noise counts as error, also with the true pose. Made by",
        "`python -m benchmarks.alignment.stress`, seed"
        f" {found['provenance']['seed']}, {found['provenance']['frames']} frames each of",
        ", ".join(f"{who.name}_{motion}" for who in _SUBJECTS for motion in _MOTIONS) + ".",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    run_as_process(StressConfig, main)
