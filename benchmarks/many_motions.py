"""What a folder of motions takes: processor time of a motion and of a frame, and then all of AMASS.

    python -m benchmarks.many_motions --out docs/results/scaling/many_motions.json

A few folders of forged motions are predicted by `dsnet predict`, each in a process of its own with
one worker. Three folders of other numbers of motions and frames give three equations for what
beginning, a motion and a frame cost. One to two minutes; processor time, so that others may use the
machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from bridge.motion.readers.amass import sample_path
from bridge.paper import N_VERTICES
from bridge.runs.writer import machine

FOLDERS = ((2, 2), (42, 2), (8, 780))
"""Motions, and frames of each; AMASS's last 13 seconds in the mean."""
AMASS = {"hours": 40, "motions": 11_000, "fps": 60}
CORES = (1, 2, 16, 128)
VERTEX_BYTES = {"offsets": 12, "offsets16": 6}
_CODE = """
from bridge.runs.workers import use_workers
use_workers(1)
from dsnet.cli import main
main()
"""


def forge(folder: Path, motions: int, frames: int) -> None:
    """The sample of dancing, again and again, as somebody else each time."""
    rng = np.random.default_rng(0)
    with np.load(sample_path("dancing")) as stored:
        arrays = {name: stored[name] for name in stored.files if name != "source"}
    there_and_back = np.concatenate(
        [np.arange(len(arrays["poses"])), np.arange(len(arrays["poses"]))[::-1]]
    )
    rows = np.resize(there_and_back, frames)
    arrays |= {name: arrays[name][rows] for name in ("poses", "trans")}
    for number in range(motions):
        betas = rng.normal(0, 1, np.shape(arrays["betas"]))
        np.savez(folder / f"{number:03d}_poses.npz", **{**arrays, "betas": betas})


def processor_s(motions: int, frames: int, write: str) -> float:
    """User and system time of the command and its worker."""
    with tempfile.TemporaryDirectory() as name:
        given = Path(name) / "given"
        given.mkdir()
        forge(given, motions, frames)
        options = ["--motion", str(given), "--out", f"{name}/out", "--write", write]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-c", _CODE, "predict", *options]
        subprocess.run(
            command, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(write: str) -> dict[str, float]:
    """Seconds of one core."""
    took_s = [processor_s(*folder, write) for folder in FOLDERS]
    equations = [[1, motions, motions * frames] for motions, frames in FOLDERS]
    begin_s, motion_s, frame_s = np.linalg.solve(equations, took_s)
    return {"begin_s": begin_s, "motion_s": motion_s, "frame_s": frame_s}


def amass(cost: dict[str, float], bytes_a_frame: int) -> dict[str, object]:
    """Core hours, bytes, and hours by number of cores, whose disk keeps up."""
    frames = AMASS["hours"] * 3600 * AMASS["fps"]
    core_s = AMASS["motions"] * cost["motion_s"] + frames * cost["frame_s"]
    return {
        "frames": frames,
        "core_hours": core_s / 3600,
        "bytes": frames * bytes_a_frame,
        "hours_by_cores": {str(cores): core_s / 3600 / cores for cores in CORES},
        "bytes_a_second_and_core": frames * bytes_a_frame / core_s,
    }


def main() -> None:
    """Measure, and write the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    found = {}
    for write, of_vertex in VERTEX_BYTES.items():
        cost = measured(write)
        frames_an_hour = 3600 / cost["frame_s"]
        found[write] = {**cost, "frames_an_hour_and_core": frames_an_hour}
        found[write]["amass"] = amass(cost, of_vertex * N_VERTICES)
    facts = {"machine": machine(), "folders": FOLDERS, "amass": AMASS, "written": found}
    out.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
