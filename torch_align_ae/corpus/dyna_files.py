"""Dyna and D-FAUST registrations in HDF5: a checking reader and an atomic writer.

`dyna_layout` says what the files hold. Only one sequence, or one window of it, is in memory at a
time, whatever the file's chunks and float type are.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.errors import DsnetError
from bridge.paper import N_VERTICES
from bridge.runs.untrusted import damage_refused, open_regular
from torch_align_ae.corpus.dyna_bounds import check_bounds, check_own, check_sides, faces_of
from torch_align_ae.corpus.dyna_layout import (
    FACES_KEY,
    FPS,
    LAYOUT,
    REMEDY,
    DynaEntry,
    check_frames,
    check_upright,
    entry_of,
    is_sequence,
)

__all__ = ["FPS", "DynaEntry", "DynaReader", "DynaWriter", "MeshClip", "write_dyna"]

# Windows of an alignment are read in steps of this many frames: 1.3 MB a chunk.
FRAMES_PER_CHUNK = 16
_CHUNK_CACHE_BYTES = 8 << 20


class DynaReader:
    """Sequences of one or more files, in file order; a context manager.

    Iterating yields `(entry, frames)` with frames (T, 6890, 3) float32 in metres.

    Raises
    ------
    DsnetError
        If a file is missing, damaged, of another layout, in other units, turned, or holds a
        sequence name twice.
    """

    def __init__(self, paths: Iterable[Path | str]) -> None:
        self._files: list[h5py.File] = []
        self._file_of: dict[str, h5py.File] = {}
        self.entries: list[DynaEntry] = []
        try:
            for path in map(Path, paths):
                self._add_file(path)
            if not self.entries:
                raise DsnetError("no mesh file", LAYOUT, "Pass --dyna FILE.h5.")
        except BaseException:
            self.close()
            raise

    @cached_property
    def faces(self) -> NDArray[np.int64] | None:
        """(13776, 3) vertex indices of the first file, or None when it has none.

        Raises
        ------
        DsnetError
            If what is stored under their name is no list of SMPL's faces.
        """
        path = Path(self._files[0].filename)
        with _damage_named(path):
            return faces_of(path, self._files[0].get(FACES_KEY))

    def frames(self, name: str, start: int = 0, stop: int | None = None) -> NDArray[np.float32]:
        """Frames `start` to `stop` of one sequence, (n, 6890, 3) float32, metres.

        Raises
        ------
        DsnetError
            If there is no such sequence, or its values cannot be read or are not a person's.
        """
        if name not in self._file_of:
            raise DsnetError(
                f"sequence {name!r}", f"one of {list(self._file_of)}", "Check the spelling."
            )
        return _frames(self._file_of[name], name, start, stop)

    def clip(self, name: str) -> MeshClip:
        """One sequence, to be read now or in another process."""
        return MeshClip(self._file_of[name], name)

    def __iter__(self) -> Iterator[tuple[DynaEntry, NDArray[np.float32]]]:
        for entry in self.entries:
            yield entry, self.frames(entry.name)

    def __len__(self) -> int:
        return len(self.entries)

    def __enter__(self) -> DynaReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close every file."""
        for file in self._files:
            file.close()

    def _add_file(self, path: Path) -> None:

        def refusal(error: Exception) -> DsnetError:
            kind = "a folder" if isinstance(error, IsADirectoryError) else "no such file"
            return DsnetError(f"mesh file {path}: {kind}", LAYOUT, "Check the path.")

        with damage_refused(refusal):
            open_regular(path).close()
        with _damage_named(path):
            file = _open(path)
            self._files.append(file)
            check_own(path, file)
            found = 0
            for name, dataset in file.items():
                if not is_sequence(name, dataset):
                    continue
                found += 1
                check_bounds(path, name, dataset)
                self._add_sequence(entry_of(path, name, dataset), file)
            if not found:
                raise DsnetError(f"{path}: no sequences among {list(file)[:5]}", LAYOUT, REMEDY)

    def _add_sequence(self, entry: DynaEntry, file: h5py.File) -> None:
        if entry.name in self._file_of:
            first = self._file_of[entry.name].filename
            raise DsnetError(
                f"sequence {entry.name} twice, in {first} and {entry.path}",
                "every sequence once",
                "Pass each file once, and not Dyna's and D-FAUST's of the same people.",
            )
        self._file_of[entry.name] = file
        self.entries.append(entry)
        first = self.frames(entry.name, 0, 1)[0]
        check_upright(entry.path, entry.name, first)
        check_sides(entry.path, entry.name, first, self.faces)


@dataclass(frozen=True)
class MeshClip:
    """A sequence of meshes in a file that was checked; another process opens the file itself."""

    file: h5py.File
    name: str

    def read(self, start: int, stop: int) -> NDArray[np.float32]:
        """Frames [start, stop) as (n, 6890, 3) metres; errors as `DynaReader.frames`."""
        return _frames(self.file, self.name, start, stop)

    def __reduce__(self) -> tuple[Any, ...]:
        return _clip_again, (str(Path(self.file.filename).resolve()), self.name)


def _clip_again(path: str, name: str) -> MeshClip:
    return MeshClip(_opened_again(path), name)


@lru_cache(maxsize=16)
def _opened_again(path: str) -> h5py.File:
    """Once in a process, not once for each of thousands of sequences."""
    return _open(Path(path))


def _frames(file: h5py.File, name: str, start: int, stop: int | None) -> NDArray[np.float32]:
    path = Path(file.filename)
    with _damage_named(path):
        # Opened anew each time: as long as a data set is open HDF5 keeps its latest chunks, some
        # megabytes of each sequence.
        dataset = file[name]
        assert isinstance(dataset, h5py.Dataset)
        stored = dataset[:, :, start:stop]
    # What float32 cannot hold becomes infinite, and is refused as such.
    with np.errstate(over="ignore"):
        frames = np.ascontiguousarray(np.moveaxis(stored, -1, 0), dtype=np.float32)
    check_frames(path, name, start, frames)
    return frames


def _open(path: Path) -> h5py.File:
    return h5py.File(path, "r", rdcc_nbytes=_CHUNK_CACHE_BYTES)


class DynaWriter:
    """Appends sequences to a file that `write_dyna` opened."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file

    def add(self, name: str, frames: ArrayLike) -> None:
        """Store (T, 6890, 3) vertices in metres under `<subject>_<motion>`."""
        vertices = np.asarray(frames, dtype=np.float32)
        if vertices.ndim != 3 or vertices.shape[1:] != (N_VERTICES, 3) or not len(vertices):
            raise DsnetError(
                f"sequence {name} of shape {vertices.shape}",
                f"(T, {N_VERTICES}, 3) with at least one frame",
                "Pass frames first.",
            )
        chunks = (N_VERTICES, 3, min(FRAMES_PER_CHUNK, len(vertices)))
        # Chunk by chunk, so that the transposed copy stays small.
        dataset = self._file.create_dataset(
            name, (N_VERTICES, 3, len(vertices)), np.float32, chunks=chunks
        )
        for start in range(0, len(vertices), FRAMES_PER_CHUNK):
            window = slice(start, start + FRAMES_PER_CHUNK)
            dataset[:, :, window] = np.moveaxis(vertices[window], 0, -1)


@contextmanager
def write_dyna(path: Path | str, faces: ArrayLike) -> Iterator[DynaWriter]:
    """Write a Dyna-format file sequence by sequence; it appears at `path` only when complete.

    Examples
    --------
    >>> with write_dyna("dyna_female.h5", faces) as writer:  # doctest: +SKIP
    ...     writer.add("50004_hips", vertices_m)
    """
    path = Path(path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    os.close(handle)
    partial = Path(temporary)
    try:
        with h5py.File(partial, "w") as file:
            file.create_dataset(FACES_KEY, data=np.asarray(faces, dtype=np.uint32))
            yield DynaWriter(file)
        partial.chmod(0o644)
        os.replace(partial, path)
    except BaseException:
        partial.unlink()
        raise


def _damage_named(path: Path) -> AbstractContextManager[None]:
    return damage_refused(
        lambda error: DsnetError(
            f"mesh file {path}: not readable as HDF5 ({str(error)[:200]})", LAYOUT, REMEDY
        )
    )
