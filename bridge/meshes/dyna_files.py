"""Dyna and D-FAUST registrations in HDF5, read with checks and written whole.

`dyna_checks` says what the files hold. Only one sequence, or one window of it, is in memory at a
time, whatever the file's chunks and float type are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.errors import DsnetError, notify
from bridge.meshes import dyna_checks
from bridge.meshes.dyna_checks import FACES_KEY, LAYOUT, REMEDY
from bridge.paper import N_VERTICES
from bridge.runs.untrusted import damage_refused, open_regular

# Each gender is aligned and trained apart (Section 3.2).
DYNA_SUBJECTS = {
    "female": ("50004", "50020", "50021", "50022", "50025"),
    "male": ("50002", "50007", "50009", "50026", "50027"),
}
_OTHER = {"female": "male", "male": "female"}
# Windows of an alignment are read in steps of this many frames: 1.3 MB a chunk.
FRAMES_PER_CHUNK = 16
_CHUNK_CACHE_BYTES = 8 << 20


@dataclass(frozen=True)
class DynaSequence:
    """One sequence of meshes: the data set `name`, `<subject>_<motion>`, of a file."""

    path: Path
    name: str
    length: int  # frames, at least 1

    @property
    def subject(self) -> str:
        """What stands before the first underscore."""
        return self.name.partition("_")[0]

    @property
    def motion(self) -> str:
        """The rest: `one_leg_jump`, but also `running_on_spot_bugfix`."""
        return self.name.partition("_")[2]

    def read(self, start: int = 0, stop: int | None = None, every: int = 1) -> NDArray[np.float32]:
        """Frames [start, stop) as (n, 6890, 3), metres, or of every so many of the vertices, in
        any thread or process; DsnetError if values cannot be read or are not a person's."""
        with _opened(self.path) as file:
            dataset = file[self.name]
            assert isinstance(dataset, h5py.Dataset)
            stored = dataset[::every, :, start:stop]
        # What float32 cannot hold becomes infinite, and is refused as such.
        with np.errstate(over="ignore"):
            frames = np.ascontiguousarray(np.moveaxis(stored, -1, 0), dtype=np.float32)
        dyna_checks.check_frames(self.path, self.name, start, frames)
        return frames


def dyna_sequences(paths: Iterable[Path | str]) -> list[DynaSequence]:
    """The sequences of one or more files, in file order; DsnetError if a file is missing, damaged,
    of another layout, in other units, turned, or holds a sequence name twice."""
    sequences: dict[str, DynaSequence] = {}
    for path in map(Path, paths):
        for sequence in _sequences_of(path):
            if sequence.name in sequences:
                first = sequences[sequence.name].path
                raise DsnetError(
                    f"sequence {sequence.name} twice, in {first} and {path}",
                    "every sequence once",
                    "Pass each file once, and not Dyna's and D-FAUST's of the same people.",
                )
            sequences[sequence.name] = sequence
    if not sequences:
        raise DsnetError("no mesh file", LAYOUT, "Pass --dyna FILE.h5.")
    return list(sequences.values())


def _sequences_of(path: Path) -> list[DynaSequence]:
    def refusal(error: Exception) -> DsnetError:
        kind = "a folder" if isinstance(error, IsADirectoryError) else "no such file"
        return DsnetError(f"mesh file {path}: {kind}", LAYOUT, "Check the path.")

    with damage_refused(refusal):
        open_regular(path).close()
    with _opened(path) as file:
        dyna_checks.check_items(path, file)
        sequences = [
            DynaSequence(path.resolve(), name, dyna_checks.check_sequence(path, name, item))
            for name, item in file.items()
            if dyna_checks.is_sequence(name, item)
        ]
        if not sequences:
            raise DsnetError(f"{path}: no sequences among {list(file)[:5]}", LAYOUT, REMEDY)
        faces = dyna_checks.read_faces(path, file.get(FACES_KEY))
    for sequence in sequences:
        dyna_checks.check_standing(path, sequence.name, sequence.read(0, 1)[0], faces)
    return sequences


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    def refusal(error: Exception) -> DsnetError:
        received = f"mesh file {path}: not readable as HDF5 ({str(error)[:200]})"
        return DsnetError(received, LAYOUT, REMEDY)

    with damage_refused(refusal), h5py.File(path, "r", rdcc_nbytes=_CHUNK_CACHE_BYTES) as file:
        yield file


def of_one_gender(sequences: Sequence[DynaSequence], gender: str) -> list[DynaSequence]:
    """The sequences that a body model of `gender` fits; subjects who are not Dyna's are kept.

    Sequences of the other gender are left out, and a line on stderr says how many, so that
    `--dyna dyna_female.h5 dyna_male.h5` serves either body model. Refused if nothing remains, or
    if the body model's gender cannot choose between women and men.
    """
    of_other_gender = set(DYNA_SUBJECTS.get(_OTHER.get(gender, ""), ()))
    subjects = {sequence.subject for sequence in sequences}
    if subjects <= of_other_gender:
        raise DsnetError(
            f"subjects {sorted(subjects)}, who are {_OTHER[gender]}, with a {gender} body model",
            f"Dyna's {gender} subjects {', '.join(DYNA_SUBJECTS[gender])}",
            f"Pass the {_OTHER[gender]} body model, or the {gender} mesh file.",
        )
    if not of_other_gender and all(subjects & set(known) for known in DYNA_SUBJECTS.values()):
        raise DsnetError(
            f"women and men ({', '.join(sorted(subjects))}) with a body model of gender {gender}",
            "one gender a run, as in the paper",
            "Pass SMPL's female or male model, or mesh files of one gender.",
        )
    kept = [sequence for sequence in sequences if sequence.subject not in of_other_gender]
    if left_out := len(sequences) - len(kept):
        why = f"{_OTHER[gender]} subjects, {gender} body model"
        notify(f"{left_out} of {len(sequences)} sequences left out: {why}")
    return kept


@contextmanager
def write_dyna(path: Path, faces: ArrayLike) -> Iterator[Callable[[str, NDArray], None]]:
    """Write a Dyna-format file: what it gives adds (T, 6890, 3) vertices in metres under
    `<subject>_<motion>`."""
    with h5py.File(path, "w") as file:
        file.create_dataset(FACES_KEY, data=np.asarray(faces, dtype=np.uint32))

        def add(name: str, frames: NDArray) -> None:
            shape = (N_VERTICES, 3, len(frames))
            chunks = (N_VERTICES, 3, min(FRAMES_PER_CHUNK, len(frames)))
            dataset = file.create_dataset(name, shape, np.float32, chunks=chunks)
            # Chunk by chunk, so that the transposed copy stays small.
            for start in range(0, len(frames), FRAMES_PER_CHUNK):
                window = slice(start, start + FRAMES_PER_CHUNK)
                dataset[:, :, window] = np.moveaxis(frames[window], 0, -1)

        yield add
