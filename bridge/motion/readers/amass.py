"""`.npz` of SMPL's family, as AMASS has them and many others write them, Meshcapade's `.smpl`, and
the short synthetic motions of the package, which are such files.

`python tools/build_sample_motions.py` makes the samples.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.body.safe_pickle import load_restricted_item
from bridge.errors import DsnetError, did_you_mean
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, HowRead, Motion
from bridge.motion.readers.smpl_arrays import (
    BETAS_KEYS,
    BODY_KEYS,
    MOST_BYTES,
    PART_KEYS,
    POSE_KEYS,
    ROOT_KEYS,
    WANTED,
    WHOLE_KEYS,
    gender_stored,
    holds_poses,
    motion_of,
    unusable,
)
from bridge.runs.untrusted import NpyHeader, UntrustedNpz, file_refused, open_npz

SAMPLE_PREFIX = "sample:"
CYCLE = "walk_cycle"
"""The one that repeats, in place: its last frame is its first again."""
SAMPLES = ("dancing", "jumping_jacks", CYCLE, "walking")

_MOST_BYTES = dict.fromkeys((*POSE_KEYS, *PART_KEYS, *ROOT_KEYS, *BODY_KEYS), MOST_BYTES)
_MOST_BYTES |= dict.fromkeys(("trans", "transl", "bodyTranslation"), MOST_FRAMES * 24)
_MOST_BYTES |= {"dmpls": MOST_FRAMES * 64} | dict.fromkeys(BETAS_KEYS, MOST_FRAMES * 128)
_MOST_TEXT_BYTES = 1 << 12


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file, or a sample that comes with the package (`sample:walking`)."""
    # Other arrays (markers) may be large or pickled; they are not touched.
    # It may be a sample's name alone.
    missing = did_you_mean(
        str(path), () if path.suffix else SAMPLES, "Check the path.", SAMPLE_PREFIX
    )
    refused = file_refused(path, unusable, "Download the file again.", missing=missing)
    with refused, open_npz(motion_path(path)) as archive:
        whole = any(key in archive for key in WHOLE_KEYS)
        arrays = _arrays(archive, [key for key in WANTED if not whole or key not in PART_KEYS])
    return motion_of(path, arrays, how)


def gender_of(path: Path) -> str | None:
    """The gender that a file states, or None if it has no poses and so is no motion."""
    with file_refused(path, unusable, "Download it again."), open_npz(path) as archive:
        return gender_stored(_arrays(archive, ("gender",))) if holds_poses(archive) else None


def motion_path(name_or_path: Path | str) -> Path:
    """The file of `sample:walking` and the like; any other path as it is."""
    name = str(name_or_path)
    if not name.startswith(SAMPLE_PREFIX):
        return Path(name_or_path)
    sample = name.removeprefix(SAMPLE_PREFIX)
    if sample not in SAMPLES:
        known = ", ".join(SAMPLE_PREFIX + sample for sample in SAMPLES)
        remedy = did_you_mean(
            sample, SAMPLES, "Name one of these, or an AMASS file.", SAMPLE_PREFIX
        )
        raise DsnetError(f"motion {name}", known, remedy)
    return sample_path(sample)


def sample_path(name: str) -> Path:
    """Where a sample lies, or will when it is built."""
    return Path(str(resources.files("bridge.motion"))) / "samples" / f"{name}.npz"


def _arrays(archive: UntrustedNpz, wanted: Iterable[str]) -> dict[str, NDArray]:
    """Those of the wanted arrays that there are, none of which is read before all are checked."""
    there = [key for key in wanted if key in archive]
    pickled = [key for key in there if archive[key].dtype.hasobject and not holds_poses({key})]
    plain = [key for key in there if key not in pickled]
    for key in plain:
        archive.check(key, _MOST_BYTES.get(key, _MOST_TEXT_BYTES))
    objects = {key: _object(archive, key) for key in pickled}
    return {key: archive.array(key) for key in plain} | {
        key: np.array(value) for key, value in objects.items() if value is not None
    }


def _object(archive: UntrustedNpz, key: str) -> str | int | float | None:
    """What stands in an array of one object: text or a number; of a list of one, its item."""
    with archive.member(key) as stream:
        NpyHeader.read(stream)
        item = load_restricted_item(stream)
    item = item[0] if isinstance(item, (list, tuple)) and len(item) == 1 else item
    item = item.decode("latin1") if isinstance(item, bytes) else item
    if not isinstance(item, (str, int, float)) and item is not None:
        raise pickle.UnpicklingError(f"{key!r} is an object of another kind")
    return item
