"""Ask pip whether the wheel and its extras could be installed on other systems.

    python -m tools.try_wheels --out docs/results/wheels.json

Nothing is installed or run: pip resolves what the wheel and each extra ask for, from wheels alone
and in the versions of `constraints.txt`, for each system below. The conditions on the system in
this project's own requirements are those of that system; in what those packages ask for in turn,
pip takes those of the machine that it runs on. The answer is that of the index which pip asks here.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from packaging.requirements import Requirement

from tools.built_wheel import ROOT, asked_by, build_wheel

PYTHON = "3.12"
SYSTEMS = {
    "Windows, x86": ("win32", "AMD64", ["win_amd64"]),
    "macOS, Arm": ("darwin", "arm64", ["macosx_14_0_arm64"]),
    "Linux, Arm": ("linux", "aarch64", [f"manylinux_2_{glibc}_aarch64" for glibc in (17, 28, 34)]),
}
"""`sys.platform`, the processor, and the tags of wheels that it takes."""
EXTRAS = ("", "train", "train-cpu", "usd", "abc", "clip", "fbx", "ray")
"""Those of somebody who uses the project; `""` is the wheel alone."""


def main() -> None:
    """Ask for all of them, print the answers and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="JSON: system → extra → what pip lacks, or null")
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        lines = asked_by(build_wheel(Path(folder)))
    cases = [(system, extra) for system in SYSTEMS for extra in EXTRAS]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda case: lacking(requirements(lines, *case), case[0]), cases))
    answers: dict[str, dict[str, str | None]] = {system: {} for system in SYSTEMS}
    for (system, extra), lacks in zip(cases, found, strict=True):
        answers[system][extra] = lacks
        print(f"{system:14} {extra or 'the wheel alone':16} {lacks or 'yes'}")
    if out:
        out.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


def requirements(lines: Sequence[str], system: str, extra: str) -> list[str]:
    """What the wheel asks for there with an extra, without its conditions."""
    platform, machine, _ = SYSTEMS[system]
    environment = {"sys_platform": platform, "platform_machine": machine, "extra": extra}
    environment |= {"python_version": PYTHON, "python_full_version": f"{PYTHON}.0"}
    asked = []
    for one in map(Requirement, lines):
        if one.marker is None or one.marker.evaluate(environment):
            one.marker = None
            asked.append(str(one))
    return asked


def lacking(asked: Sequence[str], system: str) -> str | None:
    """What pip has no wheel of there, in its words; `None` if it has all."""
    tags = [f"--platform={tag}" for tag in SYSTEMS[system][2]]
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    only = ["--dry-run", "--ignore-installed", "--only-binary=:all:", f"--python-version={PYTHON}"]
    only.append(f"--constraint={ROOT / 'constraints.txt'}")
    with tempfile.TemporaryDirectory() as target:
        command = [*pip, *only, *tags, f"--target={target}", *asked]
        done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")]
    return errors[-1].removeprefix("ERROR: ") if done.returncode else None


if __name__ == "__main__":
    main()
