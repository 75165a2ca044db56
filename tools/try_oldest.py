"""Run DSNet's tests with the oldest TensorFlow and Keras that `pyproject.toml` allows.

    python -m tools.try_oldest                              all of tests/tf_dsnet
    python -m tools.try_oldest tests/tf_dsnet/test_fit.py   some of them

In an environment of its own (2 GB of the temporary folder), with the newest other packages that go
with these two, and without PyTorch. If they cannot be had, a line says so; if they exclude one
another, or a test fails, so does the command.
"""

from __future__ import annotations

import platform
import re
import sys
import tempfile
from pathlib import Path

from tools.built_wheel import ROOT, asked_by, build_wheel
from tools.try_pythons import TESTERS, last_line, run, say

TESTS = ("tests/tf_dsnet",)
_CONFLICT = "ResolutionImpossible"
INSTALL_S, TESTS_S = 900, 1800
"""At most, for the packages and for the tests."""


def main() -> int:
    """Try them; the exit status."""
    oldest = oldest_frameworks((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as name:
        needs = [line for line in asked_by(build_wheel(Path(name))) if "extra ==" not in line]
        return 0 if works(oldest, needs, sys.argv[1:] or [*TESTS], Path(name) / "venv") else 1


def oldest_frameworks(pyproject: str) -> list[str]:
    """Of TensorFlow and Keras, as the extra `train` allows them: `keras==3.5.0` and so on."""
    least = dict(re.findall(r'"(keras|tensorflow)>=([\d.]+)"', pyproject))
    if sys.platform == "linux" and platform.machine() == "x86_64":
        least["tensorflow-cpu"] = least.pop("tensorflow")
    return [f"{name}=={version}" for name, version in least.items()]


def works(oldest: list[str], needs: list[str], tests: list[str], folder: Path) -> bool:
    """Whether the tests pass with these packages, or cannot be tried; it is said which."""
    named = ", ".join(oldest)
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)]).check_returncode()
    own = str(folder / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--python", own, "--quiet", "--disable-pip-version-check"]
    install = [*pip, "install", "--no-compile", "--retries", "1", "--only-binary", ":all:"]
    installed = run([*install, *oldest, "h5py", *needs, *TESTERS], timeout=INSTALL_S)
    if _CONFLICT in installed.stderr:
        say(f"{named}: these versions exclude one another\n{installed.stderr}")
        return False
    if installed.returncode:
        say(f"{named}: not tried, for packages cannot be had: {last_line(installed)}")
        return True
    pytest = [own, "-m", "pytest", "--basetemp", str(folder / "tests"), "-p", "no:cacheprovider"]
    done = run([*pytest, "-q", "-n", "0", *tests], cwd=ROOT, timeout=TESTS_S)
    if done.returncode:
        say(f"{named}: tests failed\n{done.stdout}{done.stderr}")
        return False
    say(f"{named}: {last_line(done)}")
    return True


if __name__ == "__main__":
    sys.exit(main())
