"""The comparison for people: a table in Markdown, and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.alignment.absorption_figures import (
    Drawn,
    draw_absorption,
    draw_error_bodies,
)
from benchmarks.alignment.contenders import Estimate
from benchmarks.alignment.known_sequences import KnownSequence
from benchmarks.alignment.scores import Scores, body_of
from bridge.body.model_data import SMPL_JOINT_NAMES
from bridge.body.posing import pose_vertices
from bridge.motion import unpack_theta
from bridge.paper import FPS
from dsnet.report.curves import TRUE_POSE, draw_figure10

# The paper's example; its subject there is 50025, who is lean in the synthetic corpus.
_FIGURE10_SEQUENCE, _FIGURE10_JOINT = "50004_jiggle_on_toes", "spine2"
# In Okabe and Ito's colours, told apart by every reader.
_DRAWN = {
    "sgd": Drawn("the paper's SGD", "#D55E00"),
    "smplfitter_known_shape_10": Drawn("smplfitter", "#009E73", "--"),
    "robust": Drawn("ours", "#0072B2"),
}

_COLUMNS = {
    "frames/s": lambda a: f"{a['frames_per_s']:.3g}",
    "mesh distance [mm]": lambda a: f"{a['residual_mm']['mean']:.2f}",
    "pose error, mean [deg]": lambda a: f"{a['pose_deg']['mean']:.3f}",
    "95 % [deg]": lambda a: f"{a['pose_deg']['p95']:.2f}",
    "translation error [mm]": lambda a: f"{a['trans_mm']['mean']:.2f}",
    "offset error [mm]": lambda a: f"{a['offsets']['mean_mm']:.2f}",
    "R² of all": lambda a: f"{a['r2']:.3f}",
    "R² of the worst": lambda a: f"{a['r2_worst']:.2f}",
    "which is": lambda a: a["worst_sequence"],
    "R² without toes": lambda a: f"{a['r2_without_toes']:.3f}",
    "absorbed [%]": lambda a: f"{100 * a['absorption']['whole']['absorbed']:.1f}",
}

_RULE = ["---", *("---:" for _ in _COLUMNS)]
_PAGE = """\
# Aligners on the {suite} sequences (synthetic data)

{table}

R² is that of the offsets against the simulated truth, 0 for SMPL alone; `absorbed` is the share of
the true offsets that pose and shape took. smplfitter never turns the toes, hence the column without
the vertices that they move.

{count} sequences of {frames} frames, seed {seed}: {sequences}.

Frames/s: median of {rounds} rounds (the paper's SGD: one), turn by turn, from meshes to poses,
shapes included; {threads} threads of {machine}. Made by `{command}`.
"""


def markdown(results: Mapping[str, Any]) -> str:
    """The table, what it was measured on, and how."""
    suite, provenance = results["suite"], results["provenance"]
    rows = [
        [aligner["title"], *(column(aligner) for column in _COLUMNS.values())]
        for aligner in results["aligners"].values()
    ]
    return _PAGE.format(
        suite=suite["name"].replace("_", "-"),
        table="\n".join(f"| {' | '.join(row)} |" for row in [["aligner", *_COLUMNS], _RULE, *rows]),
        count=len(suite["pairs"]),
        frames=suite["frames"],
        seed=suite["seed"],
        sequences=", ".join(f"{subject}_{motion}" for subject, motion in suite["pairs"]),
        rounds=provenance["config"]["rounds"],
        threads=provenance["config"]["threads"],
        machine=provenance["machine"],
        command=provenance["command"],
    )


def draw_figures(
    folder: Path,
    suite_name: str,
    known: Sequence[KnownSequence],
    estimates: Mapping[str, Sequence[Estimate]],
    scores: Mapping[str, Scores],
    panel_px: int,
) -> None:
    """Figure 10 if its sequence is among the known ones; absorption as bars and on a body."""
    drawn = {name: look for name, look in _DRAWN.items() if name in estimates}
    if not drawn:
        return
    for row, one in enumerate(known):
        if one.recording.name == _FIGURE10_SEQUENCE:
            found = {
                look.label: _rotation(estimates[name][row].theta) for name, look in drawn.items()
            }
            draw_figure10(
                folder / f"figure10_{suite_name}.png",
                {TRUE_POSE: _rotation(one.theta), **found},
                fps=FPS,
                title=f"Figure 10: rotation vector of {_FIGURE10_JOINT}, {one.recording.name}",
                origin="synthetic",
            )
    absorptions = {look: scores[name].errors.absorption for name, look in drawn.items()}
    draw_absorption(
        folder / f"absorption_{suite_name}.png",
        {look: one.summary() for look, one in absorptions.items()},
        title="What alignment takes from the offsets, and what it adds",
        origin="synthetic",
    )
    rms_m = {look: np.sqrt(one.sums[:2] / one.frames) for look, one in absorptions.items()}
    draw_error_bodies(
        folder / f"absorption_body_{suite_name}.png",
        _standing_body(),
        body_of("female").faces,
        next(iter(rms_m.values()))[0],
        {look: error for look, (_, error) in rms_m.items()},
        title="True offsets and the aligners' errors, over all sequences",
        origin="synthetic",
        panel_px=panel_px,
    )


def _rotation(theta: NDArray[np.floating]) -> NDArray[np.floating]:
    return unpack_theta(theta)[0][:, SMPL_JOINT_NAMES.index(_FIGURE10_JOINT)]


def _standing_body() -> NDArray[np.float64]:
    """(V, 3) mean body with its arms lowered."""
    pose = np.zeros((1, 22, 3))
    pose[0, SMPL_JOINT_NAMES.index("left_shoulder"), 2] = -1.0
    pose[0, SMPL_JOINT_NAMES.index("right_shoulder"), 2] = 1.0
    return pose_vertices(body_of("female"), np.zeros((1, 10)), pose, np.zeros((1, 3)))[0]
