"""`python -m benchmarks.prediction.recordings --out FILE.md --motions FOLDER`: recorded motions.

People of the corpus, known and new, do what others recorded, with simulated tissue: as recorded,
and with the noise left out by `--smooth-hz auto` for simulation and model alike. A run's model
and its tissue's law are the test bed's; no stage has seen these motions. They were chosen by
their kind, before any was scored; they have licences of their own and lie elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks import plugin
from benchmarks.processes import run_as_process
from bridge.body import load_body_model
from bridge.body.posing import shaped_joints
from bridge.errors import DsnetError, notify
from bridge.motion.cuts import pieces_between_cuts
from bridge.motion.resampling import load_motion
from bridge.motion.smoothing import SmoothHz
from bridge.paper import FPS
from bridge.runs import Run
from bridge.runs.files import write_text_atomically
from dsnet.evaluation.metrics import BIN_HZ, ErrorSums, Offsets, SpectrumSums
from dsnet.prediction.load_model import load_model
from dsnet.prediction.models import predict_whole
from dsnet.synthetic.subjects import SUBJECTS, UNSEEN
from dsnet.synthetic.tissue_laws import tissue_named

GOAL_R2 = 0.85
_BANDAI = (
    "BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset:dataset/"
    "Bandai-Namco-Research-Motiondataset-1/data/dataset-1_"
)
_XIA = "DeepMotionEditing/deep-motion-editing:style_transfer/data/xia_test/"
_GANIMATOR = "PeizhuoLi/ganimator:data/"
MOTIONS = {
    "bandai_walk.bvh": _BANDAI + "walk_normal_001.bvh",
    "bandai_run.bvh": _BANDAI + "run_happy_001.bvh",
    "bandai_dash.bvh": _BANDAI + "dash_active_001.bvh",
    "bandai_dance.bvh": _BANDAI + "dance-short_normal_001.bvh",
    "bandai_kick.bvh": _BANDAI + "kick_normal_001.bvh",
    "bandai_punch.bvh": _BANDAI + "punch_normal_001.bvh",
    "xia_strutting.bvh": _XIA + "strutting_01_000.bvh",
    "xia_sexy.bvh": _XIA + "sexy_01_000.bvh",
    "xia_angry.bvh": _XIA + "angry_13_000.bvh",
    "xia_neutral.bvh": _XIA + "neutral_16_000.bvh",
    "xia_depressed.bvh": _XIA + "depressed_18_000.bvh",
    "cmu_01_01.bvh": "facebookresearch/fairmotion:tests/data/01_01.bvh",
    "cmu_12_01.bvh": "VictorS-67/pybvh:bvh_data/cmu_12_01_walk.bvh",
    "mixamo_salsa.bvh": _GANIMATOR + "Joe/Salsa-Dancing-6.bvh",
    "mixamo_circle.bvh": _GANIMATOR + "Joe/Walk-In-Circle.bvh",
    "mixamo_gangnam.bvh": _GANIMATOR + "Malcolm/Gangnam-Style.bvh",
    "movingstories_walk.bvh": "omimo/PyMO:demos/data/AV_8Walk_Meredith_HVHA_Rep1.bvh",
    "toolbox_walk01.bvh": "OlafHaag/bvh-toolbox:tests/example_files/source/walk01.bvh",
}
"""Files, and where on GitHub each is from."""
_LONGEST_FRAMES = 300
_SETTLED_S = 0.5
"""A law of another hand may be at rest in the first frame, and a clip begins in mid-walk."""
_SLOW_HZ = 8.0
_SMOOTHED: dict[str, SmoothHz | None] = {"as recorded": None, "auto": "auto"}
_PEOPLE = ("known person", "new person")
_HEAD = ("run", "motions", "who", "clips", "true offsets [mm]", "R²", "least R²", "its clip",
         f"clips of {GOAL_R2} and more", f"R² after {_SETTLED_S:g} s", "velocity R²",
         f"true energy above {_SLOW_HZ:g} Hz", f"R² below {_SLOW_HZ:g} Hz")  # fmt: skip
_PAGE = """\
# Recorded motions under simulated tissue (synthetic data but for the motions)

{table}

`dsnet_plus` of each run of the [test bed](test_bed.md), whose name has the law of the tissue, on
{motions} recorded motions of others, their first {seconds:g} s, each done by a known and by a new
person: medians over clips of the offsets' root mean square, of R², of R² without the first
{settled:g} s, of their velocity's R², and of what is faster and slower than {slow:g} Hz.

| motion | from |
|---|---|
{sources}

Every clip and the files' digests: [recordings.json](recordings.json). Made by
`{command}`.
"""


@dataclass(frozen=True)
class RecordingsConfig:
    """Write the page, and a .json beside it."""

    out: Path
    """The page, a .md."""
    motions: Path
    """Folder with the files that `MOTIONS` names."""
    runs: tuple[str, ...] = ("bed_own", "bed_second", "bed_third")
    """With `truth` and `train_plus`."""


def main(config: RecordingsConfig) -> None:
    """Write it.

    Raises
    ------
    DsnetError
        If a motion is missing, or a run lacks a stage.
    """
    if missing := [name for name in MOTIONS if not (config.motions / name).is_file()]:
        raise DsnetError(
            f"--motions {config.motions} without {', '.join(missing)}",
            "the files that benchmarks/prediction/recordings.py names",
            "Copy them there from the repositories that stand beside them.",
        )
    plugin.use()
    result = {
        "runs": {name: _clips(name, config.motions) for name in config.runs},
        "sha256": {
            name: hashlib.sha256((config.motions / name).read_bytes()).hexdigest()
            for name in MOTIONS
        },
        "command": " ".join(["python", "-m", "benchmarks.prediction.recordings", *sys.argv[1:]]),
    }
    path = config.out.with_suffix(".json")
    write_text_atomically(path, json.dumps(result, indent=1) + "\n")
    write_text_atomically(config.out, markdown(path))


def markdown(path: Path) -> str:
    """The page of a .json."""
    result = json.loads(path.read_text(encoding="utf-8"))
    rows = ["| " + " | ".join(_HEAD) + " |", "|---" * 3 + "|---:" * 4 + "|---" + "|---:" * 5 + "|"]
    for run, clips in result["runs"].items():
        for smoothed in _SMOOTHED:
            for who in _PEOPLE:
                found = [c for c in clips if (c["smoothed"], c["who"]) == (smoothed, who)]
                rows.append("| " + " | ".join([f"`{run}`", smoothed, who, *_cells(found)]) + " |")
    return _PAGE.format(
        table="\n".join(rows),
        motions=len(MOTIONS),
        seconds=_LONGEST_FRAMES / FPS,
        settled=_SETTLED_S,
        slow=_SLOW_HZ,
        sources="\n".join(f"| `{name}` | `{source}` |" for name, source in MOTIONS.items()),
        command=result["command"],
    )


def _cells(clips: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    worst = min(clips, key=lambda clip: clip["r2"])
    yield str(len(clips))
    yield f"{median(clip['true_mm'] for clip in clips):.2f}"
    yield f"{median(clip['r2'] for clip in clips):.3f}"
    yield f"{worst['r2']:.3f}"
    yield f"`{worst['motion']}`"
    yield str(sum(clip["r2"] >= GOAL_R2 for clip in clips))
    yield f"{median(clip['settled_r2'] for clip in clips):.3f}"
    yield f"{median(clip['velocity_r2'] for clip in clips):.3f}"
    yield f"{100 * median(clip['fast_share'] for clip in clips):.0f} %"
    yield f"{median(clip['slow_r2'] for clip in clips):.3f}"


def _clips(run: str, folder: Path) -> list[dict[str, Any]]:
    """Scores of every motion, as recorded and smoothed, of a known and of a new person."""
    with ProcessPoolExecutor() as pool:
        each = pool.map(partial(_clips_of, run, folder), MOTIONS)
        return [clip for clips in each for clip in clips]


def _clips_of(run: str, folder: Path, name: str) -> list[dict[str, Any]]:
    notify(f"{run}: {name}")
    truth, row = Run(run).artifact("truth"), [*MOTIONS].index(name)
    people = (SUBJECTS["female"], UNSEEN["female"])
    body, model = load_body_model("embedded:female"), load_model(Run(run), "dsnet_plus").model
    found = []
    for who, known in zip(_PEOPLE, people, strict=True):
        betas = known[row % len(known)].betas
        tissue = tissue_named(truth.manifest["tissue"])(body, betas, gravity=True)
        joint_m = shaped_joints(body, betas[None])[0, 0]
        for smoothed, smooth_hz in _SMOOTHED.items():
            motion = load_motion(folder / name, smooth_hz=smooth_hz)
            theta = motion.about_root_joint(joint_m).theta
            theta = theta[pieces_between_cuts(theta)[0]][:_LONGEST_FRAMES].astype(np.float64)
            true_m = tissue.offsets(theta, FPS)
            found_m = np.concatenate(list(predict_whole(model, theta, betas).offsets_m))
            settled = slice(round(_SETTLED_S * FPS), None)
            velocity = ErrorSums.of(np.diff(found_m, axis=0), np.diff(true_m, axis=0))
            energy = SpectrumSums.of(Offsets(found_m, FPS), Offsets(true_m, FPS)).energy
            slow = energy[:, : round(_SLOW_HZ / BIN_HZ)].sum(axis=1)
            found.append(
                {
                    "motion": name,
                    "who": who,
                    "smoothed": smoothed,
                    "frames": len(theta),
                    "true_mm": round(1e3 * float(np.sqrt(np.square(true_m).sum(-1).mean())), 3),
                    "r2": round(ErrorSums.of(found_m, true_m).r2, 4),
                    "settled_r2": round(ErrorSums.of(found_m[settled], true_m[settled]).r2, 4),
                    "velocity_r2": round(velocity.r2, 4),
                    "fast_share": round(1 - float(slow[0] / energy[0].sum()), 4),
                    "slow_r2": round(1 - float(slow[2] / slow[0]), 4),
                }
            )
    return found


if __name__ == "__main__":
    run_as_process(RecordingsConfig, main)
