"""Folders of motions: what each form of offsets takes to write, to keep and to read.

    python -m benchmarks.flesh_folders --out docs/results/scaling/folders.json

`dsnet predict --body embedded` on one core, as a process of its own: some minutes of motion in
every form, and an hour as nodes16. The motion is the package's walking cycle, synthetic, repeated
in clips of a minute. Times are of the processor, with the start of the command, so that others may
use the machine: ten minutes if nobody does.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import dsnet
from bridge.motion.readers.amass import CYCLE, sample_path
from bridge.runs.writer import machine
from dsnet.prediction.prediction_files import OFFSETS

AMASS_FRAMES = 40 * 3600 * 60
"""Of 40 hours."""
SHORT = 2
"""Clips of a minute in every form."""
_WINDOWS, _WINDOW = 200, 64


def write_motions(folder: Path, clips: int) -> None:
    """Clips of a minute of people of different shapes, as AMASS has them."""
    folder.mkdir()
    with np.load(sample_path(CYCLE)) as sample:
        cycle = {name: np.asarray(sample[name]) for name in ("poses", "trans")}
    for number in range(clips):
        minute = {name: np.tile(array[:-1], (60, 1)) for name, array in cycle.items()}
        betas = np.random.default_rng(number).normal(0, 1, 16)
        about = {"betas": betas, "gender": "female", "mocap_framerate": 60.0}
        np.savez(folder / f"{number:02d}_poses.npz", **minute, **about)


def predicted(motions: Path, out: Path, form: str) -> dict[str, Any]:
    """What it takes, and what is there then."""
    options = ["predict", "--body", "embedded", "--write", form]
    began, before_s = time.perf_counter(), _children_s()
    code = "from dsnet.cli import main; main()"
    command = [sys.executable, "-c", code, *options, "--motion", str(motions), "--out", str(out)]
    subprocess.run(command, check=True)
    cpu_s, wall_s = _children_s() - before_s, time.perf_counter() - began
    frames = sum(len(clip) for clip in dsnet.load_flesh(out))
    held = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    return {
        "frames": frames,
        "cpu_s": cpu_s,
        "wall_s": wall_s,
        "frames_per_cpu_s": frames / cpu_s,
        "bytes": held,
        "bytes_a_frame": held / frames,
    }


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def read_speed(out: Path) -> float:
    """Frames a second of processor time, as float32, in windows anywhere; what is float32 is
    memory-mapped, and nothing is read of it before it is used."""
    clips, rng = [*dsnet.load_flesh(out)], np.random.default_rng(0)
    began = time.process_time()
    for _ in range(_WINDOWS):
        clip = clips[rng.integers(len(clips))]
        first = int(rng.integers(len(clip) - _WINDOW))
        np.asarray(clip.offsets_m[first : first + _WINDOW], np.float32)
    return _WINDOWS * _WINDOW / (time.process_time() - began)


def differs(out: Path, whole: Path) -> dict[str, float]:
    """How far offsets of one clip are from those as float32."""
    found_m, expected_m = (np.asarray(dsnet.load_flesh(folder)[0].offsets_m, np.float32)
                           for folder in (out, whole))  # fmt: skip
    apart_m = found_m - expected_m
    return {
        "largest_offset_mm": 1e3 * float(np.abs(expected_m).max()),
        "most_um": 1e6 * float(np.abs(apart_m).max()),
        "rms_share": float(np.linalg.norm(apart_m) / np.linalg.norm(expected_m)),
    }


def main(out: Path, minutes: int) -> None:
    """Measure, print and write."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    os.environ.pop("DSNET_BODY", None)
    found: dict[str, Any] = {"machine": machine(), "forms": {}, "amass_frames": AMASS_FRAMES}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for clips in (SHORT, minutes):
            write_motions(folder / str(clips), clips)
        for form in OFFSETS:
            taken = predicted(folder / str(SHORT), folder / form, form)
            taken |= {"read_frames_per_cpu_s": read_speed(folder / form)}
            found["forms"][form] = taken | differs(folder / form, folder / OFFSETS[0])
        found["long"] = predicted(folder / str(minutes), folder / "long", "nodes16")
    text = json.dumps(found, indent=1)
    print(text)
    out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=int, default=60, help="of the long run")
    main(**vars(parser.parse_args()))
