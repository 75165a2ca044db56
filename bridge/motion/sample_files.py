"""Short synthetic motions that come with the package, for a first look without files of one's own.

`python tools/build_sample_motions.py` makes them: `samples/<name>.npz`, in AMASS's format.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from bridge.errors import DsnetError

SAMPLE_PREFIX = "sample:"
SAMPLES = ("dancing", "jumping_jacks", "walking")


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
    if name.removeprefix(SAMPLE_PREFIX) not in SAMPLES:
        known = ", ".join(SAMPLE_PREFIX + sample for sample in SAMPLES)
        raise DsnetError(f"motion {name}", known, "Name one of these, or an AMASS file.")
    return sample_path(name.removeprefix(SAMPLE_PREFIX))


def sample_path(name: str) -> Path:
    """Where a sample lies, or will when it is built."""
    return Path(str(resources.files("bridge.motion"))) / "samples" / f"{name}.npz"
