"""What pictures and clips take, beside an earlier checkout of this project.

    python -m benchmarks.pictures --beside ../earlier --run smoke

Each tree's own `.venv` runs its commands, in turns, so that other load hits both alike. Processor
time is that of all threads and of the encoder; on a busy machine it says more than the clock.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from bridge.options import PositiveInt
from bridge.runs.writer import provenance

_HERE = Path(__file__).parents[1]
_MOTION = ("--motion", "sample:jumping_jacks")
_DSNET = ("-c", "from dsnet.cli import main; main()")
# One core from the beginning: libraries count the cores when they are loaded.
_PICTURE = """
import os, statistics, time
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from bridge.body import load_body_model
from dsnet.pictures.render import frame_camera, render_bodies
body = load_body_model("embedded:female")
camera = frame_camera([body.v_template], height_px=700, width_px=500)
def draw():
    clock, processor = time.perf_counter(), time.process_time()
    render_bodies([body.v_template], body.faces, camera=camera, colours=[None])
    return time.perf_counter() - clock, time.process_time() - processor
draw()
taken = [draw() for _ in range(5)]
print(*map(statistics.median, zip(*taken)))
"""


@dataclass(frozen=True)
class PicturesConfig:
    """Time a picture, a prediction with its strip, clips of 4 s and a report."""

    beside: Path
    """Earlier checkout, with an environment of its own in `.venv`."""
    run: str = "smoke"
    """Finished run whose report is made, again and again."""
    times: PositiveInt = 5
    """How often; medians are given."""
    out: Path = Path("docs/results/pictures.json")
    """File to write."""


Taken = tuple[float, float]
"""Seconds by the clock, and of processors."""


def main(config: PicturesConfig) -> None:
    """Time all in both trees, write a table."""
    found: dict[str, dict[str, list[float]]] = {}
    for name, arguments in _commands(config.run).items():
        taken: dict[str, list[Taken]] = {"before": [], "now": []}
        for _ in range(config.times):
            for which, tree in (("before", config.beside.resolve()), ("now", _HERE)):
                taken[which].append(_take(tree, arguments, config.run))
        found[name] = {
            which: [round(statistics.median(s), 2) for s in zip(*times, strict=True)]
            for which, times in taken.items()
        }
        sys.stdout.write(f"{name}: {found[name]}\n")
    facts = {
        "command": f"python -m benchmarks.pictures --beside EARLIER --run {config.run}",
        "machine": provenance(0.0)["machine"],
        "medians_of": config.times,
        "seconds_by_clock_and_of_processors": found,
    }
    config.out.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def _commands(run: str) -> dict[str, Sequence[str]]:
    return {
        "one body, 500 x 700 pixels, on one core": ("-c", _PICTURE),
        "predict of 4 s, with its strip": (*_DSNET, "predict", *_MOTION, "--out", "OUT"),
        "the same as a GIF": (*_DSNET, "export", *_MOTION, "--to", "gif", "--out", "OUT.gif"),
        "the same as an MP4": (*_DSNET, "export", *_MOTION, "--to", "mp4", "--out", "OUT.mp4"),
        f"report of run `{run}`": (*_DSNET, "report", "--profile", "smoke", "--run", run),
    }


def _take(tree: Path, arguments: Sequence[str], run: str) -> Taken:
    """What a command of a tree takes; a picture is timed by the process that draws it."""
    shutil.rmtree(tree / "runs" / run / "report", ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        told = [text.replace("OUT", f"{folder}/out") for text in arguments]
        command = [str(tree / ".venv" / "bin" / "python"), *told]
        start, before = time.perf_counter(), os.times()
        done = subprocess.run(command, cwd=tree, check=True, stdout=subprocess.PIPE, text=True)
        clock, after = time.perf_counter() - start, os.times()
    if _PICTURE in arguments:
        clock, processors = map(float, done.stdout.split())
        return clock, processors
    user, system = "children_user", "children_system"
    return clock, sum(getattr(after, part) - getattr(before, part) for part in (user, system))


if __name__ == "__main__":
    main(tyro.cli(PicturesConfig, description=PicturesConfig.__doc__))
