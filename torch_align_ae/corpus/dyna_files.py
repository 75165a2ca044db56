"""Dyna and D-FAUST registrations in HDF5: a checking reader and an atomic writer.

`dyna_checks` says what the files hold. Only one sequence, or one window of it, is in memory at a
time, whatever the file's chunks and float type are.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.errors import DsnetError, notify
from bridge.paper import N_VERTICES
from bridge.runs.untrusted import damage_refused, open_regular
from torch_align_ae.corpus.dyna_checks import (
    FACES_KEY,
    LAYOUT,
    REMEDY,
    DynaEntry,
    check_frames,
    check_items,
    check_standing,
    entry_of,
    faces_of,
    is_sequence,
)

FPS = 60.0
# Each gender is aligned and trained apart (Section 3.2).
DYNA_SUBJECTS = {
    "female": ("50004", "50020", "50021", "50022", "50025"),
    "male": ("50002", "50007", "50009", "50026", "50027"),
}
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

    def _add_file(self, path: Path) -> None:
        def refusal(error: Exception) -> DsnetError:
            kind = "a folder" if isinstance(error, IsADirectoryError) else "no such file"
            return DsnetError(f"mesh file {path}: {kind}", LAYOUT, "Check the path.")

        with damage_refused(refusal):
            open_regular(path).close()
        with _damage_named(path):
            file = _open(path)
            self._files.append(file)
            check_items(path, file)
            before = len(self.entries)
            for name, item in file.items():
                if is_sequence(name, item):
                    self._add_sequence(file, entry_of(path, name, item))
            if len(self.entries) == before:
                raise DsnetError(f"{path}: no sequences among {list(file)[:5]}", LAYOUT, REMEDY)

    def _add_sequence(self, file: h5py.File, entry: DynaEntry) -> None:
        if entry.name in self._file_of:
            first = self._file_of[entry.name].filename
            raise DsnetError(
                f"sequence {entry.name} twice, in {first} and {entry.path}",
                "every sequence once",
                "Pass each file once, and not Dyna's and D-FAUST's of the same people.",
            )
        self._file_of[entry.name] = file
        self.entries.append(entry)
        (vertices,) = self.frames(entry.name, 0, 1)
        check_standing(entry.path, entry.name, vertices, self.faces)

    @cached_property
    def faces(self) -> NDArray[np.int64] | None:
        """(13776, 3) vertex indices of the first file, or None when it has none."""
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
            known = f"one of {list(self._file_of)}"
            raise DsnetError(f"sequence {name!r}", known, "Check the spelling.")
        return self.clip(name).read(start, stop)

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
        for file in self._files:
            file.close()


@dataclass(frozen=True)
class MeshClip:
    """A sequence of meshes in a file that was checked; another process opens the file itself."""

    file: h5py.File
    name: str

    def read(self, start: int, stop: int | None) -> NDArray[np.float32]:
        """Frames [start, stop) as (n, 6890, 3) metres; errors as `DynaReader.frames`."""
        path = Path(self.file.filename)
        with _damage_named(path):
            # Opened anew each time: as long as a data set is open HDF5 keeps its latest chunks,
            # some megabytes of each sequence.
            dataset = self.file[self.name]
            assert isinstance(dataset, h5py.Dataset)
            stored = dataset[:, :, start:stop]
        # What float32 cannot hold becomes infinite, and is refused as such.
        with np.errstate(over="ignore"):
            frames = np.ascontiguousarray(np.moveaxis(stored, -1, 0), dtype=np.float32)
        check_frames(path, self.name, start, frames)
        return frames

    def __reduce__(self) -> tuple[Any, ...]:
        return _clip_again, (str(Path(self.file.filename).resolve()), self.name)


def _clip_again(path: str, name: str) -> MeshClip:
    return MeshClip(_opened_again(path), name)


@lru_cache(maxsize=16)
def _opened_again(path: str) -> h5py.File:
    """Once in a process, not once for each of thousands of sequences."""
    return _open(Path(path))


def _open(path: Path) -> h5py.File:
    return h5py.File(path, "r", rdcc_nbytes=_CHUNK_CACHE_BYTES)


def _damage_named(path: Path) -> AbstractContextManager[None]:
    return damage_refused(
        lambda error: DsnetError(
            f"mesh file {path}: not readable as HDF5 ({str(error)[:200]})", LAYOUT, REMEDY
        )
    )


def of_one_gender(entries: Sequence[DynaEntry], gender: str) -> list[DynaEntry]:
    """The sequences that a body model of `gender` fits; subjects who are not Dyna's are kept.

    Sequences of the other gender are left out, and a line on stderr says how many, so that
    `--dyna dyna_female.h5 dyna_male.h5` serves either body model. Refused if nothing remains, or
    if the body model's gender cannot choose between women and men.
    """
    other = {"female": "male", "male": "female"}.get(gender, "")
    strangers = DYNA_SUBJECTS.get(other, ())
    kept = [entry for entry in entries if entry.subject not in strangers]
    subjects = {entry.subject for entry in entries}
    if not kept:
        raise DsnetError(
            f"subjects {sorted(subjects)}, who are {other}, with a {gender} body model",
            f"Dyna's {gender} subjects {', '.join(DYNA_SUBJECTS[gender])}",
            f"Pass the {other} body model, or the {gender} mesh file.",
        )
    if not strangers and all(subjects & set(known) for known in DYNA_SUBJECTS.values()):
        raise DsnetError(
            f"women and men ({', '.join(sorted(subjects))}) with a body model of gender {gender}",
            "one gender a run, as in the paper",
            "Pass SMPL's female or male model, or mesh files of one gender.",
        )
    if left_out := len(entries) - len(kept):
        why = f"{other} subjects, {gender} body model"
        notify(f"{left_out} of {len(entries)} sequences left out: {why}")
    return kept


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
        shape = (N_VERTICES, 3, len(vertices))
        chunks = (N_VERTICES, 3, min(FRAMES_PER_CHUNK, len(vertices)))
        dataset = self._file.create_dataset(name, shape, np.float32, chunks=chunks)
        # Chunk by chunk, so that the transposed copy stays small.
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
