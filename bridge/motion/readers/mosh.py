"""What MoSh++ writes, `*_stageii.pkl`: a pose fitted to optical markers, and the markers.

`fullpose`, `trans` and `betas` are AMASS's `poses`, `trans` and `betas`; the rate is that of the
recording, of which MoSh++ may have fitted every other frame (`ds_rate`). Nothing in it is executed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bridge.body.safe_pickle import as_array, load_restricted
from bridge.errors import DsnetError
from bridge.motion.motion import AS_IT_SAYS, MOST_FRAMES, HowRead, Motion
from bridge.motion.readers.smpl_arrays import gender_in, motion_of
from bridge.runs.untrusted import file_refused, open_regular

_MOST_BYTES = MOST_FRAMES * 100 * 3 * 8 * 4
"""Markers as they were seen, as they were used and as they were fitted, and the pose."""
_MOST_OPCODES = 4_000_000
"""Names and markers of every frame are lists: 10,000 frames of 67 markers take 1.3 million."""
_REMEDY = "Copy it again, or pass an AMASS file (.npz)."
_ARRAYS = {"fullpose": "poses", "trans": "trans", "betas": "betas", "dmpls": "dmpls"}


def read(path: Path, how: HowRead = AS_IT_SAYS) -> Motion:
    """Read and check one file."""
    fields = load_fields(path)
    with file_refused(path, _refused, _REMEDY):
        arrays = {to: as_array(fields[key]) for key, to in _ARRAYS.items() if key in fields}
        arrays["gender"] = np.array(_gender(fields))
        details = fields.get("stageii_debug_details")
        if (rate := within(details, "mocap_frame_rate")) is not None:
            every = within(details, "cfg", "mocap", "ds_rate")
            every = every if isinstance(every, int) and every > 0 else 1
            number = rate if isinstance(rate, (int, float)) else as_array(rate).item()
            arrays["mocap_frame_rate"] = np.array(float(number) / every)
    return motion_of(path, arrays, how)


def gender_of(path: Path) -> str | None:
    """The gender that a file states; None for other pickles, such as body models."""
    return _gender(load_fields(path))


def load_fields(path: Path) -> Mapping[str, Any]:
    """What a file holds, by name: plain containers, and records for `as_array`."""
    with (
        file_refused(path, _refused, _REMEDY),
        open_regular(path, _MOST_BYTES) as file,
    ):
        fields = load_restricted(file, _MOST_OPCODES)
        if not isinstance(fields, dict) or "fullpose" not in fields:
            raise ValueError("it has no 'fullpose'")
    return fields


def within(value: Any, *names: str) -> Any:
    """What lies under names in dictionaries in one another; None where there is nothing."""
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _refused(path: Path, flaw: str, remedy: str) -> DsnetError:
    return DsnetError(f"{path}, {flaw}", "a result of MoSh++ (*_stageii.pkl)", remedy)


def _gender(fields: Mapping[str, Any]) -> str:
    stated = within(fields.get("stageii_debug_details"), "cfg", "surface_model", "gender")
    return gender_in(fields.get("gender", stated))
