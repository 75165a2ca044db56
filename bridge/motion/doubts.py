"""What is odd about a motion that is used all the same, a line each."""

from __future__ import annotations

from collections.abc import Sequence

from bridge.motion.cuts import cut_warning
from bridge.motion.free_fall import fall_warning
from bridge.motion.resampling import Motion


def doubts_about(
    motion: Motion, pieces: Sequence[slice], rate_option: str = "--motion-fps"
) -> list[str]:
    """Where it jumps, and that it falls as nobody can.

    Parameters
    ----------
    pieces : `bridge.motion.cuts.pieces_between_cuts` of it.
    rate_option : the option by which the user says the right frame rate.
    """
    found = (
        cut_warning(motion.source, pieces, motion.fps),
        fall_warning(motion, pieces, f"{rate_option} says the right one"),
    )
    return [warning for warning in found if warning]
