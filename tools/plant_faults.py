"""Plant faults in the product, one at a time, and see which of them the tests find.

    python -m tools.plant_faults                        thirty of seed 0, a line each
    python -m tools.plant_faults --out before.json      and in a file
    python -m tools.plant_faults --again before.json    the same ones, after tests have changed

A fault is a comparison turned round, a plus for a minus, another number, a `not` more or less, or a
value that a function keeps for itself. The tree is copied first; what runs for a fault are the
default tests that import its file, and those that lie in the folder which mirrors the file's.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from bridge.runs.files import write_text_atomically
from tests.smoke_run import GIVEN, finished_runs
from tools.fault_sites import KINDS, Site, faulty, sites_of
from tools.run_checks import ROOT, imported_by, tracked

PRODUCT = ("bridge/", "dsnet/", "torch_align_ae/", "tf_dsnet/")
APART = "tests/tf_dsnet/"
"""TensorFlow's tests, which share no process with PyTorch's."""


@dataclass(frozen=True)
class Config:
    """Options."""

    n: int = 30
    """Faults, as many of each kind."""
    seed: int = 0
    """Of where they are planted."""
    seconds: float = 300.0
    """The most that the tests of one fault may take."""
    again: Path | None = None
    """Plant the faults of this file, which `--out` has written, in place of seeded ones."""
    out: Path | None = None
    """Write the table into this file too, as JSON."""


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: `caught`, `missed` or `too slow`, and the test that found it."""

    site: Site
    line: int
    what: str
    became: str
    by: str


def main(config: Config) -> None:
    """Plant all, and print a line each."""
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="faults_") as name:
        copy = Path(name) / "tree"
        _copy_tree(copy)
        if GIVEN not in os.environ:  # or a faulty tree would make it
            os.environ[GIVEN] = f"{name}/runs"
            finished_runs(Path(os.environ[GIVEN]))
        planted = _again(config.again) if config.again else _seeded(config.n, config.seed)
        for site, first in planted:
            outcomes.append(_planted(copy, site, config.seconds, first))
            last = outcomes[-1]
            print(f"{site.path}:{last.line}: {last.what}: {last.became} {last.by}", flush=True)
            if config.out:
                write_text_atomically(config.out, json.dumps([*map(asdict, outcomes)], indent=1))
    print(f"{sum(one.became == 'caught' for one in outcomes)} of {len(outcomes)} caught")


def _seeded(n: int, seed: int) -> Iterator[tuple[Site, str]]:
    """As many of each kind, wherever in the product one may stand; who finds it is not known."""
    files = sorted(path for path in tracked() if path.startswith(PRODUCT) and path[-3:] == ".py")
    sites = [
        site for path in files for site in sites_of(path, (ROOT / path).read_text(encoding="utf-8"))
    ]
    rng = random.Random(seed)
    for i in range(n):
        of_kind = [site for site in sites if site.kind == list(KINDS)[i % len(KINDS)]]
        yield rng.choice(of_kind), ""


def _again(path: Path) -> Iterator[tuple[Site, str]]:
    """Each with the test that found it before, where that is still there."""
    for one in json.loads(path.read_text(encoding="utf-8")):
        file, _, name = one["by"].partition("::")
        still = file in tracked() and f"def {name.partition('[')[0]}(" in (ROOT / file).read_text(
            encoding="utf-8"
        )
        yield Site(**one["site"]), one["by"] if still else ""


def _copy_tree(copy: Path) -> None:
    for path in tracked():
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, copy / path)
    for command in ("init", "add --all"):  # for tests that ask for the repository's files
        subprocess.run(["git", *command.split()], cwd=copy, check=True, capture_output=True)


def _planted(copy: Path, site: Site, seconds: float, first: str) -> Outcome:
    """Run the tests of one fault, `first` before others; what fails without it is left out."""
    sound = (ROOT / site.path).read_text(encoding="utf-8")
    text, line, what = faulty(sound, site)
    until, broken = time.monotonic() + seconds, list[str]()
    for tests in filter(None, ([first] if first else [], *_tests_of(site.path))):
        while True:
            (copy / site.path).write_text(text, encoding="utf-8")
            try:
                failed = _first_failure(copy, tests, broken, until - time.monotonic())
            except subprocess.TimeoutExpired:
                return Outcome(site, line, what, "too slow", "")
            finally:
                (copy / site.path).write_text(sound, encoding="utf-8")
            if not failed:
                break
            if not _first_failure(copy, [failed], [], seconds):
                return Outcome(site, line, what, "caught", failed)
            broken.append(failed)
    return Outcome(site, line, what, "missed", "")


def _tests_of(path: str) -> tuple[list[str], list[str]]:
    """Other tests, and TensorFlow's; those of the file's name first."""
    tests = [test for test in sorted(tracked()) if re.fullmatch(r"tests/.*/test_\w+\.py", test)]
    importing = [test for test in tests if path in imported_by(test)]
    importing.sort(key=lambda test: Path(test).name != f"test_{Path(path).name}")
    beside, folder = list[str](), path
    while not beside:
        folder = folder.rpartition("/")[0]
        beside = [test for test in tests if test.rpartition("/")[0] == f"tests/{folder}"]
    chosen = [*dict.fromkeys([*importing, *beside])]
    return (
        [test for test in chosen if not test.startswith(APART)],
        [test for test in chosen if test.startswith(APART)],
    )


def _first_failure(copy: Path, tests: list[str], without: list[str], seconds: float) -> str:
    """The first test that fails, or the file that cannot be read; empty where all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    command += [f"--deselect={test}" for test in without]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, timeout=seconds
    )
    found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    if done.returncode in (0, 5) or "ERROR: not found:" in done.stderr:  # 5: none was chosen
        return ""
    return found.group(1) if found else tests[0]


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
