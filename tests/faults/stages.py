"""The stages of a tiny run, each as a process that can be stopped at any moment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bridge.runs import read_artifact
from bridge.runs.files import MANIFEST

RUN = "tiny"
ROOT = Path(__file__).parents[2]
_COUNTED = (str(Path(__file__).with_name("stage_process.py")),)
_CALLED = (
    "-c",
    "import json, sys; from dsnet.cli import main; main(sys.argv[2:], **json.loads(sys.argv[1]))",
)

_FEW = {
    "corpus": ("--subjects 1 --mean-frames 60 --mosh-seconds 1", {}),
    "align": ("--steps 4", {"first_frame_steps": 40, "shape_steps": 60}),
    "train-ae": ("--steps 4", {"validate_every": 2}),
    "encode": ("", {}),
    "train": (
        "--epochs 6 --rounds 3",
        {"checkpoint_every": 2, "validate_every": 2, "plus": {"steps": 2, "nodes": 100}},
    ),
    "infer": ("", {}),
    "decode": ("", {}),
    "evaluate": ("", {}),
    "report": ("", {"panel_px": 80}),
}
"""Options, and other settings."""
COMMANDS = tuple(_FEW)
ARTIFACTS = {
    **{command: (command,) for command in COMMANDS},
    "corpus": ("truth", "corpus"),
    "align": ("align", "align_robust"),
    "train": ("train", "train_plus"),
    "infer": ("infer", "infer_plus"),
}
"""What each command makes."""


@dataclass(frozen=True)
class Ended:
    """How a process ended."""

    status: int
    said: str
    """Its stderr."""
    file_operations: int
    """Below the runs' folder, until its end."""

    @property
    def lines(self) -> list[str]:
        return self.said.splitlines()


class Stage:
    """A stage under way, in a group of its own."""

    def __init__(self, command: str, runs: Path, kill_at: int = 0, *, counted: bool = True) -> None:
        """`kill_at` counts file operations: the process kills its group before that one.

        Not `counted` it is just what a user calls.
        """
        # Not below `runs`, which may be full.
        handle, name = tempfile.mkstemp()
        os.close(handle)
        self._count = Path(name)
        given, settings = _FEW[command]
        options = ["--profile", "smoke", "--run", RUN, *given.split()]
        wrapper = [sys.executable, *(_COUNTED if counted else _CALLED)]
        if counted:
            wrapper += [str(self._count), str(kill_at)]
        wrapper += [json.dumps(settings)]
        self.process = subprocess.Popen(
            [*wrapper, command, *options],
            cwd=ROOT,
            env={**os.environ, "DSNET_RUNS": str(runs)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def signal_group(self, number: int) -> None:
        """To the stage and all that it has started."""
        os.killpg(self.process.pid, number)

    def end(self) -> Ended:
        _, said = self.process.communicate(timeout=600)
        operations = int(self._count.read_text() or 0)
        self._count.unlink()
        return Ended(self.process.returncode, said, operations)


def make(command: str, runs: Path) -> Ended:
    """Run a stage to its end."""
    return Stage(command, runs).end()


def copy_before(command: str, base: Path, runs: Path) -> None:
    """All that the undisturbed run has but what `command` makes; links, as nobody writes to them.

    Later stages lie there too: they are not looked at.
    """
    for source in (base / RUN).iterdir():
        if source.name not in ARTIFACTS[command]:
            copy_linked(source, runs / RUN / source.name)


def copy_linked(source: Path, target: Path) -> None:
    """A folder whose files are links to those of `source`."""
    for path in source.rglob("*"):
        if path.is_file():
            place = target / path.relative_to(source)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.link(path, place)


def check_as_undisturbed(command: str, base: Path, runs: Path) -> None:
    """What `command` made is the undisturbed run's, byte for byte, and nothing else lies there."""
    for name in ARTIFACTS[command]:
        made, expected = (read_artifact(folder / RUN / name) for folder in (runs, base))
        made.verify()
        assert made.digests == expected.digests, name
        assert made.content_sha256 == expected.content_sha256, name
    assert names_in(runs / RUN) == names_in(base / RUN)


def names_in(run: Path) -> set[str]:
    """Everything in a run's folder: stages, and what should not be there."""
    return {path.name for path in run.iterdir()}


def finished(command: str, runs: Path) -> bool:
    return all((runs / RUN / name / MANIFEST).is_file() for name in ARTIFACTS[command])
