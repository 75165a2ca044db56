"""Ask pip whether the wheel and its extras could be installed on other systems.

    python -m tools.try_wheels --out docs/results/wheels.json

Nothing is installed or run: pip resolves what the wheel and each extra ask for, from wheels alone
and in the versions of `constraints.txt`, for each system below, whose conditions it is given in
place of this machine's. The answer is that of the index which pip asks here. Some minutes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.built_wheel import ROOT, build_wheel

PYTHON = "3.12"
SYSTEMS = {
    "Windows, x86": ("win32", "Windows", "nt", "AMD64", ["win_amd64"]),
    "macOS, Arm": ("darwin", "Darwin", "posix", "arm64", ["macosx_14_0_arm64"]),
    "Linux, Arm": ("linux", "Linux", "posix", "aarch64",
                   [f"manylinux_2_{glibc}_aarch64" for glibc in (17, 28, 34)]),
}  # fmt: skip
"""`sys_platform`, `platform_system`, `os_name`, `platform_machine`; tags of wheels."""
EXTRAS = ("", "train", "train-cpu", "usd", "abc", "clip", "fbx", "ray")
"""Those of somebody who uses the project; `""` is the wheel alone."""
_PIP = """import json, sys
from pip._internal.cli.main import main
from pip._vendor.packaging import markers
there, own = json.loads(sys.argv[1]), markers.default_environment
markers.default_environment = lambda: own() | there
sys.exit(main(sys.argv[2:]))"""
"""pip knows no option for a system's conditions."""


def main() -> None:
    """Ask for all of them, print the answers and write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="JSON: system → extra → what pip lacks, or null")
    out = parser.parse_args().out
    cases = [(system, extra) for system in SYSTEMS for extra in EXTRAS]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        wheel = build_wheel(Path(folder))
        found = pool.map(lambda case: lacking(wheel, *case), cases)
        answers: dict[str, dict[str, str | None]] = {system: {} for system in SYSTEMS}
        for (system, extra), lacks in zip(cases, found, strict=True):
            answers[system][extra] = lacks
            print(f"{system:14} {extra or 'the wheel alone':16} {lacks or 'yes'}", flush=True)
    if out:
        out.write_text(json.dumps(answers, indent=1) + "\n", encoding="utf-8")


def lacking(wheel: Path, system: str, extra: str) -> str | None:
    """What pip has no wheel of there, in its words; `None` if it has all."""
    platform, name, os_name, machine, tags = SYSTEMS[system]
    there = {"sys_platform": platform, "platform_system": name, "os_name": os_name}
    there |= {"platform_machine": machine, "python_version": PYTHON}
    there |= {"python_full_version": f"{PYTHON}.0"}
    options = ["--dry-run", "--ignore-installed", "--only-binary=:all:"]
    options += [f"--python-version={PYTHON}", f"--constraint={ROOT / 'constraints.txt'}"]
    options += [f"--platform={tag}" for tag in tags]
    with tempfile.TemporaryDirectory() as target:
        asked = f"{wheel}[{extra}]" if extra else str(wheel)
        command = ["--quiet", "--disable-pip-version-check", "install", *options]
        done = subprocess.run(
            [sys.executable, "-c", _PIP, json.dumps(there), *command, f"--target={target}", asked],
            capture_output=True, encoding="utf-8", check=False,
        )  # fmt: skip
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")]
    return " ".join(line.removeprefix("ERROR: ") for line in errors) if done.returncode else None


if __name__ == "__main__":
    main()
