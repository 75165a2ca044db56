"""Try damaged files on every reader and count what becomes of them.

`python -m tests.fuzz.campaign --inputs 10000 --json docs/results/reliability/fuzz.json`; with
`--guided`, by a Python that has atheris. With `smpl_npz=2000 amass` only these are tried, the first
with a number of its own, for some take a tenth of a second an input. Each reader has a process of
its own: `worker.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.fuzz.readers import READERS

ROOT = Path(__file__).parents[2]


def try_reader(
    name: str, inputs: int, seed: int, folder: Path, *, guided: bool = False
) -> dict[str, Any]:
    """Counts of one reader; a process that died is one input that was neither taken nor refused."""
    command = [sys.executable, "-m", "tests.fuzz.worker", name, str(inputs), str(seed), str(folder)]
    command += ["--guided"] * guided
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    child = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    try:
        return json.loads(child.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        died = f"the process ended with {child.returncode}: {child.stderr[-600:]}"
        return {
            "inputs": 0,
            "refused": 0,
            "accepted": 0,
            "other": 1,
            "max_rss_mb": 0,
            "others": [died],
        }


def numbers_of(named: Sequence[str], inputs: int) -> dict[str, int]:
    """How many files each reader is given: of those that are named, or of all."""
    numbers = {}
    for one in named or READERS:
        name, _, own = one.partition("=")
        if name not in READERS:
            raise SystemExit(f"unknown reader {name}; expected one of {', '.join(READERS)}")
        numbers[name] = int(own or inputs)
    return numbers


def main() -> int:
    """Try all, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("readers", nargs="*", metavar="NAME[=INPUTS]", help=", ".join(READERS))
    parser.add_argument("--inputs", type=int, default=1000, help="of each reader without one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="readers at the same time")
    parser.add_argument("--guided", action="store_true", help="by coverage, with atheris")
    parser.add_argument("--json", type=Path, help="where the counts go")
    parser.add_argument("--keep", type=Path, help="where inputs stay that are neither")
    options = parser.parse_args()
    numbers = numbers_of(options.readers, options.inputs)
    keep = options.keep or Path(tempfile.mkdtemp(prefix="dsnet-fuzz-"))
    result: dict[str, Any] = {}

    def tried(name: str) -> dict[str, Any]:
        folder = keep / name
        return try_reader(name, numbers[name], options.seed, folder, guided=options.guided)

    with ThreadPoolExecutor(options.jobs) as jobs:
        for name, counts in zip(numbers, jobs.map(tried, numbers), strict=True):
            result[name] = counts
            print(name, json.dumps(counts), flush=True)  # noqa: T201
    if options.json:
        counts = {n: {k: v for k, v in one.items() if k != "others"} for n, one in result.items()}
        command = " ".join(["python -m tests.fuzz.campaign", *options.readers])
        command += f" --inputs {options.inputs} --seed {options.seed}"
        command += " --guided" * options.guided
        text = json.dumps({**counts, "command": command, "seed": options.seed}, indent=1)
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(text + "\n")
    found = sum(one["other"] for one in result.values())
    print(f"{found} neither accepted nor refused; inputs in {keep}" if found else "none else")  # noqa: T201
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
