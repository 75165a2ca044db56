"""Install the wheel under every other Python that is found, and try it there.

    python -m tools.try_pythons

An environment each, with the versions of `constraints.txt` (under 3.13 the newest of NumPy, SciPy,
Matplotlib, Pillow and ONNX Runtime) and no framework: `dsnet predict` and `dsnet export` of the
wheel, away from the sources, and the tests that need no more. A Python that is not found, or for
which a package cannot be had, is named and left out; what fails in one that is there fails the
command. All together three minutes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.built_wheel import ROOT, asked_by, build_wheel

VERSIONS = ("3.10", "3.11", "3.12", "3.13")
TESTERS = ("filelock", "hypothesis", "pytest", "pytest-xdist", "ufbx")
TESTS = (
    "tests/bridge/test_errors.py",
    "tests/bridge/body/test_smpl_files.py",
    "tests/dsnet/markers/test_readers.py",
    "tests/bridge/motion",
    "tests/bridge/tissue",
    "tests/bridge/runs/test_artifact.py",
    "tests/bridge/runs/test_files.py",
)
INSTALL_S, TRY_S = 400, 900
"""At most, for a Python's packages and for one thing that is tried there."""


def main() -> int:
    """Try all of them; the exit status."""
    others = [version for version in VERSIONS if version != "{}.{}".format(*sys.version_info)]
    found = {version: python for version in others if (python := find_python(version))}
    if missing := [version for version in others if version not in found]:
        say(f"not found here: Python {', '.join(missing)}")
    with tempfile.TemporaryDirectory() as name:
        wheel = build_wheel(Path(name))

        def tried(version: str) -> bool:
            return works(version, found[version], wheel, Path(name) / version)

        # Side by side, for the tests of each keep one core busy.
        with ThreadPoolExecutor() as pool:
            return 0 if all(list(pool.map(tried, found))) else 1


def find_python(version: str) -> str | None:
    """An interpreter of that version: on the path, or one of pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    places = sorted((pyenv / "versions").glob(f"{version}.*/bin/python"))
    for place in [shutil.which(f"python{version}"), *map(str, places)]:
        # pyenv puts commands on the path that only say that they are not installed.
        ask = "import sys; print('{}.{}'.format(*sys.version_info))"
        if place and run([place, "-c", ask]).stdout.strip() == version:
            return place
    return None


def works(version: str, python: str, wheel: Path, folder: Path) -> bool:
    """Whether all goes well under this Python, or cannot be tried; it is said which."""
    run([python, "-m", "venv", "--without-pip", str(folder)]).check_returncode()
    own = str(folder / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", own, "--quiet", "--disable-pip-version-check"]
    pinned = ["--constraint", str(ROOT / "constraints.txt"), "--only-binary", ":all:"]
    install = [*pip, "install", "--no-compile"]
    # What the wheel needs before the wheel, so that only what others lack is an excuse.
    needs = [line for line in asked_by(wheel) if "extra ==" not in line]
    needed = run([*install, "--retries", "1", *pinned, *TESTERS, *needs], timeout=INSTALL_S)
    if needed.returncode:
        say(f"Python {version}: not tried, for its packages cannot be had: {last_line(needed)}")
        return True
    # Not the folder that all have in common: they end at the same time, and clear it together.
    pytest = [own, "-m", "pytest", "--basetemp", str(folder / "tests")]
    dsnet, motion = str(folder / "bin" / "dsnet"), ["--motion", "sample:walking"]
    steps = {
        "install": [*install, "--no-deps", "--no-index", str(wheel)],
        "predict": [dsnet, "predict", *motion, "--out", "out"],
        "export": [dsnet, "export", "--to", "npz", *motion, "--out", "out.npz"],
        "tests": [*pytest, "-q", "-n", "0", "-p", "no:cacheprovider", *TESTS],
    }
    said = ""
    for name, command in steps.items():
        done = run(command, cwd=ROOT if name == "tests" else folder, timeout=TRY_S)
        if done.returncode:
            say(f"Python {version}: {name} failed\n{done.stdout}{done.stderr}")
            return False
        said = last_line(done)
    say(f"Python {version}: installed, predicts, exports; {said}")
    return True


def run(
    command: list[str], cwd: Path | None = None, timeout: float = 60
) -> subprocess.CompletedProcess[str]:
    """Run a command that sees no packages but its environment's."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    try:
        return subprocess.run(
            command,
            cwd=cwd,
            env=own,
            timeout=timeout,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 124, "", f"took more than {timeout:.0f} s")


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    """The last thing that a command said."""
    return (done.stdout + done.stderr).strip().rpartition("\n")[2]


def say(what: str) -> None:
    """One line, at once."""
    print(what, flush=True)


if __name__ == "__main__":
    sys.exit(main())
