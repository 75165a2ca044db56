"""Short synthetic motions that come with the package, for a first look without files of one's own.

`python tools/build_sample_motions.py` makes them: `samples/<name>.npz`, in AMASS's format.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from bridge.errors import DsnetError, did_you_mean

SAMPLE_PREFIX = "sample:"
CYCLE = "walk_cycle"
"""The one that repeats, in place: its last frame is its first again."""
SAMPLES = ("dancing", "jumping_jacks", CYCLE, "walking")


def motion_path(name_or_path: Path | str) -> Path:
    """The file of `sample:walking` and the like; any other path as it is.

    Raises
    ------
    DsnetError
        If there is no such sample.
    """
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


def remedy_of_missing(path: Path) -> str:
    """What to do about a motion file that is not there: it may be a sample's name alone."""
    named = () if path.suffix else SAMPLES
    return did_you_mean(str(path), named, "Check the path.", SAMPLE_PREFIX)


def sample_path(name: str) -> Path:
    """Where a sample lies, or will when it is built."""
    return Path(str(resources.files("bridge.motion"))) / "samples" / f"{name}.npz"
