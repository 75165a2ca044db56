"""Ask pip whether the package and its extras resolve to wheels on platforms that it never ran on.

    python -m tools.try_platforms    # writes docs/results/platforms.json; minutes, needs an index

Nothing is installed or run. Markers of the package's own requirements are read for the platform;
those of what they require in turn pip reads for the machine that it runs on.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from packaging.requirements import Requirement

from bridge.runs.files import write_text_atomically
from tools.built_wheel import ROOT, asked_by, build_wheel

PYTHON = "3.11"
OUT = ROOT / "docs" / "results" / "platforms.json"
ANSWER_S = 300
"""At most, for one question: an index without metadata of wheels gives all of them."""
EXTRAS = ("", "train-cpu", "usd", "abc", "clip", "ray")
PLATFORMS = {
    "Windows, 64 bits": ("win32", "AMD64", ["win_amd64"]),
    "macOS 14, Apple silicon": (
        "darwin",
        "arm64",
        [f"macosx_{n}_0_{kind}" for n in range(14, 10, -1) for kind in ("arm64", "universal2")],
    ),
    "Linux, 64-bit Arm": (
        "linux",
        "aarch64",
        [f"manylinux_2_{n}_aarch64" for n in (28, 27, 26, 24, 17)] + ["manylinux2014_aarch64"],
    ),
}
"""By name, what Python says there (`sys.platform`, `platform.machine()`) and pip's tags."""


def main() -> None:
    """Write the answers: true, or the line that says what there is no wheel of."""
    with tempfile.TemporaryDirectory() as folder:
        requires = [Requirement(line) for line in asked_by(build_wheel(Path(folder)))]
    answers: dict[str, dict[str, bool | str]] = {}
    for name, (system, machine, tags) in PLATFORMS.items():
        here = {
            "sys_platform": system,
            "platform_machine": machine,
            "python_version": PYTHON,
            "python_full_version": f"{PYTHON}.0",
        }
        answers[name] = {}
        for extra in EXTRAS:
            wanted = [one for one in requires if _holds(one, {**here, "extra": extra})]
            answers[name][extra or "base"] = answer = resolves(wanted, tags)
            print(f"{name}, {extra or 'base'}: {answer}", flush=True)
    write_text_atomically(OUT, json.dumps(answers, indent=1) + "\n")


def resolves(requires: list[Requirement], tags: list[str]) -> bool | str:
    """Whether pip finds wheels of all of these and of what they require; its last line if not."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed"]
    command += ["--disable-pip-version-check", "--only-binary", ":all:", "--python-version", PYTHON]
    command += ["--target", "nowhere", *(part for tag in tags for part in ("--platform", tag))]
    command += [f"{one.name}{one.specifier}" for one in requires]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=ANSWER_S
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {ANSWER_S} s"
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
    return True if done.returncode == 0 else (errors or ["?"])[-1].removeprefix("ERROR: ")


def _holds(requirement: Requirement, environment: dict[str, str]) -> bool:
    return requirement.marker is None or requirement.marker.evaluate(environment)


if __name__ == "__main__":
    main()
