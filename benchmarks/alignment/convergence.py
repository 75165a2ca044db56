"""`python -m benchmarks.alignment.convergence --out DIR`: the paper's aligner against its steps.

The paper gives the rate and the momentum of its SGD, but neither the number of steps nor when a
frame is done. On clips of a synthetic corpus, whose truth is known, each rule aligns the same
frames, with the true shapes and with those that the paper's method finds in frame 1. One rule
departs from the paper, to show where the floor comes from: its rate falls to zero in each frame.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from benchmarks.alignment.descent_rules import ClipSet, Rule, track
from benchmarks.alignment.known_clips import KnownClips, load_clips
from benchmarks.processes import run_as_process
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from bridge.runs.writer import provenance
from torch_align_ae.alignment.mesh_distance import MeshDistance
from torch_align_ae.alignment.sgd import Descent, fit_shape_and_pose, rigid_start
from torch_align_ae.body import SMPL


@dataclass(frozen=True)
class ConvergenceConfig:
    """Align clips with known truth by many stopping rules: about 8 minutes on two cores, 2 GB."""

    out: Path
    """Folder that receives convergence.json."""
    run: str = "demo"
    """Run whose synthetic corpus and truth are read."""
    seed: int = 0
    """Recorded only: nothing in the descent is random."""
    subjects: tuple[str, ...] = ("50004", "50020", "50022")
    """Subjects; none of the held-out ones."""
    motions: tuple[str, ...] = ("one_leg_jump", "jiggle_on_toes", "shake_arms", "hips")
    """Motions; none of the held-out ones."""
    start: int = 48
    """First frame of each clip: the synthetic motions begin standing still."""
    frames: int = 12
    """Frames of each clip."""
    steps: tuple[int, ...] = (10, 30, 50, 100, 140, 200, 400, 800)
    """Fixed numbers of steps for each frame."""
    decayed_steps: tuple[int, ...] = (50, 140, 400)
    """Numbers of steps over which the rate falls to zero."""
    patience: tuple[int, ...] = (3, 10, 30)
    """Steps without coming closer after which a frame is done."""
    most_steps: int = 400
    """The most that a frame may take then."""
    first_frame_steps: int = 2000
    """Steps for the frame before each clip's first, from a rigidly placed template."""
    shape_steps: int = 8000
    """Steps for each subject's shape in frame 1."""

    def rules(self) -> list[Rule]:
        """All rules to compare."""
        return [
            *(Rule(steps) for steps in self.steps),
            *(Rule(steps, decays=True) for steps in self.decayed_steps),
            *(Rule(self.most_steps, patience=patience) for patience in self.patience),
        ]


def main(config: ConvergenceConfig) -> dict[str, Any]:
    """Measure and write the results; also returns them.

    Raises
    ------
    DsnetError
        If the run has no synthetic corpus, or not these sequences or frames.
    """
    begun = time.perf_counter()
    names = [f"{subject}_{motion}" for subject in config.subjects for motion in config.motions]
    frames = slice(config.start, config.start + config.frames)
    smpl, known = load_clips(Run(config.run), names, frames)
    rows, shapes_rms = _measure(config, smpl, known)
    results = {
        "data": "synthetic",
        "clips": names,
        "betas_rms_frame_1": shapes_rms,
        "rules": rows,
        "config": {key: value for key, value in asdict(config).items() if key != "out"},
        "provenance": {
            **provenance(time.perf_counter() - begun),
            "command": ["python", "-m", "benchmarks.alignment.convergence", *sys.argv[1:]],
        },
    }
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results, indent=1) + "\n"
    write_text_atomically(config.out / "convergence.json", text)
    return results


def _measure(
    config: ConvergenceConfig, smpl: SMPL, known: KnownClips
) -> tuple[list[dict[str, Any]], float]:
    """Errors of every rule with either shapes; and how far those of frame 1 are from the truth."""
    objective, descent = MeshDistance(smpl), Descent(shape_steps=config.shape_steps)
    first = objective.arrange(known.first_frames)
    fitted, *_ = fit_shape_and_pose(objective, first, descent)
    betas = {"true": known.betas, "frame 1": fitted}
    clips = _clips(objective, known, list(betas.values()), config.first_frame_steps)
    rows = []
    rules = config.rules()
    with tqdm(total=sum(r.steps for r in rules), unit="step", disable=None) as progress:
        for rule in rules:
            found = track(clips, rule, descent)
            for (shape, values), pose, trans, steps in zip(
                betas.items(), *(part.chunk(len(betas)) for part in found), strict=True
            ):
                errors = known.errors(smpl, values, pose, trans)
                taken = {"mean_steps": float(steps.double().mean())}
                rows.append({"kind": rule.kind, **asdict(rule), "betas": shape, **taken, **errors})
            progress.update(rule.steps)
    return rows, float((fitted - known.betas).square().mean().sqrt())


def _clips(
    objective: MeshDistance, known: KnownClips, betas: list[torch.Tensor], first_frame_steps: int
) -> ClipSet:
    """Every clip with every set of shapes, one set after another, at the frame before."""
    bodies = torch.cat([values[known.subjects] for values in betas])
    shapes = objective.shapes(bodies)
    before = objective.arrange(known.before).repeat(len(betas), 1)
    targets = [objective.arrange(meshes) for meshes in known.meshes.unbind(1)]
    start = ClipSet(shapes, before[None], *rigid_start(shapes, before))
    found = track(start, Rule(first_frame_steps), Descent())
    return ClipSet(
        shapes,
        torch.stack(targets).repeat(1, len(betas), 1),
        found.pose[:, 0],
        found.trans[:, 0],
    )


if __name__ == "__main__":
    run_as_process(ConvergenceConfig, main)
