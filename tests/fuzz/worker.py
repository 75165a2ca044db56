"""One reader in a process of its own: within 1 GB and 30 s of processor time an input.

`python -m tests.fuzz.worker READER INPUTS SEED FOLDER` prints counts as JSON. What neither is
accepted nor refused stays in FOLDER, also when the process dies of it. With `--guided` atheris
chooses inputs by the branches that they take.
"""

from __future__ import annotations

import faulthandler
import json
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from bridge import DsnetError

MEMORY_BYTES = 1 << 30
CPU_S = 30.0
_ROUND = 1000
"""Inputs between which hypothesis forgets what it has tried: it keeps all of it in memory."""


class TooSlowError(BaseException):
    """An input took longer than `CPU_S`; nothing may catch it."""


class Counts:
    """What became of the inputs of one reader."""

    def __init__(self, read: Callable[[Path], object], folder: Path) -> None:
        self.read, self.folder = read, folder
        self.accepted = self.refused = 0
        self.others: list[str] = []

    def take(self, files: dict[str, bytes]) -> None:
        """Read one input and count what becomes of it."""
        current = self.folder / "current"
        shutil.rmtree(current, ignore_errors=True)
        current.mkdir(parents=True)
        for name, content in files.items():
            (current / name).write_bytes(content)
        signal.setitimer(signal.ITIMER_PROF, CPU_S)
        faulthandler.dump_traceback_later(600, exit=True)
        try:
            self.read(current)
        except DsnetError as error:
            self._refused(error)
        except (Exception, TooSlowError) as error:
            self._other(error)
        else:
            self.accepted += 1
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            faulthandler.cancel_dump_traceback_later()

    def _refused(self, error: DsnetError) -> None:
        """A refusal, if it is one printable line and was not given for want of memory."""
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, MemoryError):
            cause = cause.__cause__
        if cause is not None or not str(error).isprintable() or len(str(error)) > 8000:
            self._other(error)
        else:
            self.refused += 1

    def _other(self, error: BaseException) -> None:
        place = traceback.extract_tb(error.__traceback__)[-1]
        told = (
            f"{type(error).__name__}: {error!s:.200} ({Path(place.filename).name}:{place.lineno})"
        )
        shutil.copytree(self.folder / "current", self.folder / f"other-{len(self.others)}")
        self.others.append(told)

    def summary(self) -> dict[str, Any]:
        """Counts, and the memory that the process took at most."""
        return {
            "inputs": self.accepted + self.refused + len(self.others),
            "refused": self.refused,
            "accepted": self.accepted,
            "other": len(self.others),
            "max_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
            "others": sorted(set(self.others))[:20],
        }


def limit_memory() -> None:
    """Let the process have `MEMORY_BYTES` more than it has now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _too_slow(*_: Any) -> None:
    raise TooSlowError(f"more than {CPU_S:g} s")


def main(name: str, inputs: int, first_seed: int, folder: Path, guided: bool) -> None:
    """Try `inputs` files on a reader."""
    from tests.fuzz.readers import READERS

    reader = READERS[name]
    counts, files = Counts(reader.read(), folder), reader.files()
    signal.signal(signal.SIGPROF, _too_slow)
    limit_memory()
    if guided:
        from tests.fuzz.guided import guide

        guide(given(files)(counts.take), inputs, first_seed, folder, counts.summary)
    for start in range(0, inputs, _ROUND):
        plain = settings(
            max_examples=min(_ROUND, inputs - start),
            database=None,
            deadline=None,
            suppress_health_check=[*HealthCheck.__members__.values()],
            phases=[Phase.generate],
        )
        seed(first_seed + start)(plain(given(files)(lambda files: counts.take(files))))()
    print(json.dumps(counts.summary()))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]), "--guided" in sys.argv)
