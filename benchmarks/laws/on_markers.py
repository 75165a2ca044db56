"""`python -m benchmarks.laws.on_markers --motion FILE --out DIR`: a tissue law beside skin markers.

As `dsnet evaluate --markers`, but of the law itself, simulated on the person of the file, not of a
predictor that was trained on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.plugin import tissues
from benchmarks.processes import run_as_process
from bridge.body import load_body_model
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError
from bridge.motion.resampling import load_motion
from bridge.options import PositiveFloat
from bridge.paper import FPS
from dsnet.markers.bone_pose import bone_motion
from dsnet.markers.comparison_files import write_comparisons
from dsnet.markers.marker_files import markers_of
from dsnet.markers.registration import register
from dsnet.markers.skin import compare_offsets
from dsnet.synthetic.simulation import TissueSimulator


@dataclass(frozen=True)
class OnMarkersConfig:
    """Simulate a motion under a law and compare it with the markers of its file."""

    motion: Path
    """An AMASS `.npz` with markers."""
    out: Path
    """Folder that receives markers.json, markers.md and markers.png."""
    tissue: str = "own"
    """Law: own, second or third."""
    motion_fps: PositiveFloat | None = None
    """Frames per second of the motion, where what its file says is wrong."""


def main(config: OnMarkersConfig) -> None:
    """Write the comparison, on the pose of the file and on one whose chest follows bone."""
    motion = load_motion(config.motion, config.motion_fps, FPS)
    gender = motion.gender if motion.gender in ("female", "male") else "female"
    body = load_body_model(f"embedded:{gender}")
    motion = motion.about_root_joint(shaped_joints(body, motion.betas[None])[0, 0])
    registered = register(body, motion, markers_of(motion))
    bony = bone_motion(body, motion, registered.cloud)
    laws = {"own": TissueSimulator, **tissues()}
    if config.tissue not in laws:
        raise DsnetError(f"--tissue {config.tissue}", ", ".join(laws), "Name one of them.")
    law = laws[config.tissue](body, motion.betas, gravity=True)
    comparisons = {}
    for name, one in {"pose of the file": motion, "pose by markers on bone": bony}.items():
        offsets_m = law.offsets(one.theta, FPS)
        comparisons[name] = compare_offsets(body, one, offsets_m, registered)
    config.out.mkdir(parents=True, exist_ok=True)
    write_comparisons(lambda name: config.out / name, comparisons, FPS)


if __name__ == "__main__":
    run_as_process(OnMarkersConfig, main)
