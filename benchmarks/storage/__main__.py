"""Bytes, errors and speeds of every way to store a run's offsets and meshes.

    python -m benchmarks.storage --run demo             # on a quiet machine
    python -m benchmarks.storage --run demo --no-timed  # sizes and errors alone

writes docs/results/storage/storage.json and storage.md. Each way is given the same clips: the
middle of some sequences, as many frames as a block of a packed file has; they begin more calmly.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tyro
from numpy.typing import NDArray

from benchmarks.storage.candidates import Encoding, candidates
from benchmarks.storage.page import page
from benchmarks.storage.subspace import Subspace
from bridge.exchange.packed.layout import FRAMES_PER_BLOCK
from bridge.motion import sequences_of
from bridge.options import PositiveInt
from bridge.runs import Run
from bridge.runs.provenance import provenance
from torch_align_ae.corpus.dyna_files import DynaReader

Result = TypeVar("Result")
ARRAYS = (("align_robust", "offsets"), ("predict_plus", "offsets_dsnet_plus"), ("align", "offsets"))
_SUBSPACES = (32, 128)


@dataclass(frozen=True)
class StorageConfig:
    """Compare ways to store a run's vertices."""

    run: str = "demo"
    """A finished run."""
    clips: PositiveInt = 8
    """How many sequences, evenly from all."""
    fitted: PositiveInt = 200
    """Frames, evenly from all, that the subspaces are fitted to."""
    timed: bool = True
    """Whether to take speeds, which only a quiet machine gives."""
    out: Path = Path("docs/results/storage")
    """Folder to write."""


@dataclass(frozen=True)
class StoredSize:
    """What one way gives for one kind of vertices."""

    source: str
    label: str
    bound_mm: float | None
    bytes_per_frame: float
    """With its share of what is stored once for all frames of the run."""
    ratio: float
    """Of float32 to this."""
    largest_mm: float
    """Largest error of a coordinate."""
    mean_mm: float
    """Mean error of a coordinate, in size."""
    encode_mb_s: float | None
    """Megabytes of float32 a second."""
    decode_mb_s: float | None


@dataclass(frozen=True, eq=False)
class Source:
    """Vertices of one kind."""

    name: str
    clips: list[NDArray[np.float32]]
    """Each (n, V, 3), metres."""
    fitted: NDArray[np.float32]
    """(m, V, 3), for subspaces."""
    frames: int
    """Of the whole run."""


def main(config: StorageConfig) -> None:
    """Measure, print a line each, write both files."""
    rows: list[dict[str, Any]] = []
    for source in sources(config):
        for row in compare(source, config.timed):
            sys.stdout.write(f"{source.name:<32}{row.label:<46}{row.bytes_per_frame:>9.0f} bytes\n")
            rows.append(asdict(row))
        _write(config, rows)  # source by source: it takes minutes


def _write(config: StorageConfig, rows: list[dict[str, Any]]) -> None:
    results = {
        "run": config.run,
        "data": Run(config.run).artifact("corpus").origin,
        "clips": config.clips,
        "frames": FRAMES_PER_BLOCK,
        "machine": provenance(0.0)["machine"] if config.timed else None,
        "rows": rows,
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "storage.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (config.out / "storage.md").write_text(page(results), encoding="utf-8")


def sources(config: StorageConfig) -> Iterator[Source]:
    """The run's offsets by each road that is there, then its meshes."""
    run = Run(config.run)
    for stage, name in ARRAYS:
        if run.finished(stage):
            artifact = run.artifact(stage)
            array, sequences = artifact.array(name), sequences_of(artifact)
            clips = [np.array(array[s.frames][_middle(s.length)])
                     for s in _evenly(sequences, config.clips)]  # fmt: skip
            fitted = np.array(array[:: max(1, len(array) // config.fitted)])
            yield Source(f"`{stage}/{name}`", clips, fitted, len(array))
    corpus = run.artifact("corpus")
    files = [corpus.file(name) for name in corpus.manifest["files"] if name.endswith(".h5")]
    with DynaReader(files) as reader:
        frames = sum(entry.length for entry in reader.entries)
        clips = [reader.frames(one.name, 0, one.length)[_middle(one.length)]
                 for one in _evenly(reader.entries, config.clips)]  # fmt: skip
        few = max(1, config.fitted // len(reader))
        spread = [(one.name, frame) for one in reader.entries
                  for frame in _evenly(range(one.length), few)]  # fmt: skip
        fitted = [reader.frames(name, frame, frame + 1) for name, frame in spread]
        yield Source("meshes of `corpus`", clips, np.concatenate(fitted), frames)


def compare(source: Source, timed: bool) -> Iterator[StoredSize]:
    """A row for each way."""
    subspaces = {count: Subspace.fitted(source.fitted, count) for count in _SUBSPACES}
    for candidate in candidates(subspaces):
        yield measure(source, candidate, timed)


def measure(source: Source, candidate: Encoding, timed: bool) -> StoredSize:
    """Store and read back every clip of one kind."""
    sizes, apart_mm, writing_s, reading_s = [], [], 0.0, 0.0
    for clip in source.clips:
        data, seconds = _timed(partial(candidate.encode, clip))
        writing_s += seconds
        n, vertices, sides = clip.shape
        again, seconds = _timed(partial(candidate.decode, data, (n, vertices, sides)))
        reading_s += seconds
        sizes.append(len(data))
        apart_mm.append(1e3 * np.abs(again.astype(np.float64) - clip).reshape(-1))
    frames, raw = sum(map(len, source.clips)), sum(clip.nbytes for clip in source.clips)
    share = candidate.shared_bytes / source.frames
    per_frame = sum(sizes) / frames + share
    errors_mm = np.concatenate(apart_mm)
    return StoredSize(
        source.name,
        candidate.label,
        candidate.bound_mm,
        per_frame,
        raw / frames / per_frame,
        float(errors_mm.max()),
        float(errors_mm.mean()),
        raw / 1e6 / writing_s if timed else None,
        raw / 1e6 / reading_s if timed else None,
    )


def _evenly(items: Sequence[Any], count: int) -> list[Any]:
    chosen = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[index] for index in chosen]


def _middle(length: int) -> slice:
    start = max(0, (length - FRAMES_PER_BLOCK) // 2)
    return slice(start, start + FRAMES_PER_BLOCK)


def _timed(work: Callable[[], Result]) -> tuple[Result, float]:
    started = time.perf_counter()
    result = work()
    return result, time.perf_counter() - started


if __name__ == "__main__":
    main(tyro.cli(StorageConfig))
