"""Whether pip finds wheels of all that an installation needs on systems that are not at hand.

    python -m tools.try_wheels --out docs/results/wheels.json

Asks the index that pip uses for the versions of constraints.txt, for each system and extra, and
installs nothing. Environment markers of what is required in turn are this machine's, as pip has it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from importlib.metadata import requires
from pathlib import Path

from packaging.requirements import Requirement

from bridge.runs.files import write_text_atomically

SYSTEMS = {
    "Windows": (("win_amd64",), "win32", "AMD64"),
    "macOS, Arm": (("macosx_14_0_arm64",), "darwin", "arm64"),
    "Linux, Arm": (
        tuple(f"manylinux_2_{glibc}_aarch64" for glibc in (28, 27, 17)),
        "linux",
        "aarch64",
    ),
}
"""Tags of wheels that a system takes, and its `sys_platform` and `platform_machine`."""
EXTRAS = ("", "usd", "abc", "clip", "train", "train-cpu", "ray")
PYTHON = "3.11"
_CONSTRAINTS = Path(__file__).parents[1] / "constraints.txt"


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="file for the answers")
    out = parser.parse_args().out
    answers = {system: {extra: missing(system, extra) for extra in EXTRAS} for system in SYSTEMS}
    write_text_atomically(out, json.dumps({"python": PYTHON, "missing": answers}, indent=1) + "\n")


def missing(system: str, extra: str) -> list[str]:
    """The requirements that have no wheel there, with all that they require in turn."""
    wanted = requirements(system, extra)
    return [] if found(system, wanted) else [one for one in wanted if not found(system, [one])]


def requirements(system: str, extra: str) -> list[str]:
    """What an extra asks for on a system, or the installation without one."""
    _tags, platform, machine = SYSTEMS[system]
    there = {
        "sys_platform": platform,
        "platform_machine": machine,
        "python_version": PYTHON,
        "python_full_version": f"{PYTHON}.0",
    }
    wanted = []
    for text in requires("dsnet-skin") or []:
        one, marker = Requirement(text), Requirement(text).marker
        of_base = marker is None or marker.evaluate({**there, "extra": ""})
        if of_base if not extra else not of_base and marker.evaluate({**there, "extra": extra}):
            wanted.append(f"{one.name}{one.specifier}")
    return wanted


def found(system: str, wanted: list[str]) -> bool:
    """Whether pip resolves them by wheels alone."""
    tags = [option for tag in SYSTEMS[system][0] for option in ("--platform", tag)]
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"),
            *("--only-binary", ":all:", "--python-version", PYTHON, "--target", folder),
            *("--constraint", str(_CONSTRAINTS)),
            *tags,
            *wanted,
        ]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0


if __name__ == "__main__":
    main()
