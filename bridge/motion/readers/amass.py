"""`.npz` of SMPL's family, as AMASS has them and many others write them, Meshcapade's `.smpl`, and
the short synthetic motions of the package, which are such files.

`python tools/build_sample_motions.py` makes the samples.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from bridge.body.containers import npz_fields
from bridge.errors import DsnetError, did_you_mean
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, HowRead, Motion
from bridge.motion.readers import pickles
from bridge.motion.readers.joint_rotations import unusable
from bridge.motion.readers.markers import markers_beside_poses
from bridge.motion.readers.smpl_arrays import is_of_embedded, motion_of
from bridge.motion.readers.smpl_fields import (
    BESIDE_KEYS,
    BETAS_KEYS,
    BODY_KEYS,
    MOST_BYTES,
    NESTS,
    PART_KEYS,
    POSE_KEYS,
    ROOT_KEYS,
    TRANS_KEYS,
    WANTED,
    WHOLE_KEYS,
    arrays_of,
    gender_stored,
    holds_poses,
    unprefixed,
)
from bridge.runs.untrusted import UntrustedNpz, file_refused, open_npz

SAMPLE_PREFIX = "sample:"
CYCLE = "walk_cycle"
"""The one that repeats, in place: its last frame is its first again."""
SAMPLES = ("dancing", "jumping_jacks", CYCLE, "walking")

_MOST_TEXT_BYTES = 1 << 12
_MOST_BYTES = dict.fromkeys(WANTED, _MOST_TEXT_BYTES)
_MOST_BYTES |= dict.fromkeys((*POSE_KEYS, *PART_KEYS, *ROOT_KEYS, *BODY_KEYS), MOST_BYTES)
_MOST_BYTES |= dict.fromkeys((*TRANS_KEYS, "Rh", "Th"), MOST_FRAMES * 24)
_MOST_BYTES |= dict.fromkeys(BESIDE_KEYS, MOST_FRAMES * 72)
_MOST_BYTES |= {"dmpls": MOST_FRAMES * 64} | dict.fromkeys(BETAS_KEYS, MOST_FRAMES * 128)


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file, or a sample that comes with the package (`sample:walking`)."""
    # Other arrays may be large or pickled; they are not touched.
    # It may be a sample's name alone.
    missing = did_you_mean(
        str(path), () if path.suffix else SAMPLES, "Check the path.", SAMPLE_PREFIX
    )
    refused = file_refused(path, unusable, "Download the file again.", missing=missing)
    with refused, open_npz(motion_path(path)) as archive:
        if nested := _nested(archive):
            return pickles.motion_in(path, nested, how)[0]
        whole = any(key in archive for key in WHOLE_KEYS)
        unread = PART_KEYS if whole else ()
        sizes = {n: _MOST_BYTES.get(n.rpartition(":")[2]) for n in archive if n not in unread}
        # Of what may have another meaning only what is small is looked at.
        wanted = {
            name: most
            for name, most in sizes.items()
            if most and (name not in BESIDE_KEYS or archive[name].size_bytes <= most)
        }
        arrays = arrays_of(npz_fields(archive, wanted), strict=True)
        markers = markers_beside_poses(archive, motion_path(path))
    return replace(motion_of(path, arrays, how), markers=markers)


def gender_of(path: Path) -> str | None:
    """The gender that a file states, or None if it has no poses and so is no motion."""
    with file_refused(path, unusable, "Download it again."), open_npz(path) as archive:
        if nested := _nested(archive):
            return pickles.gender_in_file(nested)
        if not holds_poses(unprefixed(dict.fromkeys(archive))):
            return None
        stated = npz_fields(archive, {"gender": _MOST_TEXT_BYTES})
        return gender_stored(arrays_of(stated, strict=True))


def _nested(archive: UntrustedNpz) -> dict[str, Any]:
    """All fields, if one of them that may be a dictionary with poses is one."""
    nests = [n for n in NESTS if n in archive and archive[n].dtype.hasobject]
    if not nests or holds_poses(archive):
        return {}
    of_all = {name: most for name, most in _MOST_BYTES.items() if most == _MOST_TEXT_BYTES}
    fields = npz_fields(archive, {**of_all, **dict.fromkeys(nests, 0)})
    return {name: value for name, value in fields.items() if value is not None}


def is_smpl_family(path: Path) -> bool:
    """Whether a motion is of SMPL's family, and not of an embedded body."""
    with file_refused(path, unusable, "Download it again."), open_npz(motion_path(path)) as archive:
        stated = npz_fields(archive, dict.fromkeys(("source", "body_model"), _MOST_TEXT_BYTES))
        return not is_of_embedded(arrays_of(stated, strict=True))


def motion_path(name_or_path: Path | str) -> Path:
    """The file of `sample:walking` and the like; any other path as it is."""
    name = str(name_or_path)
    if not name.startswith(SAMPLE_PREFIX):
        return Path(name_or_path)
    sample = name.removeprefix(SAMPLE_PREFIX)
    if sample not in SAMPLES:
        samples = ", ".join(SAMPLE_PREFIX + sample for sample in SAMPLES)
        remedy = did_you_mean(
            sample, SAMPLES, "Name one of these, or an AMASS file.", SAMPLE_PREFIX
        )
        raise DsnetError(f"motion {name}", samples, remedy)
    return sample_path(sample)


def sample_path(name: str) -> Path:
    """Where a sample lies, or will when it is built."""
    return Path(str(resources.files("bridge.motion"))) / "samples" / f"{name}.npz"
