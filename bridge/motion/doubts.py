"""What is odd about a motion that is used all the same, a line each."""

from __future__ import annotations

from collections.abc import Sequence

from bridge.motion.cuts import cut_warning
from bridge.motion.free_fall import fall_warning
from bridge.motion.lead_in import lead_in_notice
from bridge.motion.pops import pop_warning
from bridge.motion.resampling import Motion
from bridge.motion.tremor import tremor_warning


def doubts_about(
    motion: Motion,
    pieces: Sequence[slice],
    rate_option: str = "--motion-fps",
    smooth_option: str = "--smooth-hz auto",
) -> list[str]:
    """What of the file was left out, where it jumps, and how it moves as nobody can.

    Parameters
    ----------
    pieces : `bridge.motion.cuts.pieces_between_cuts` of it.
    rate_option : the option by which the user says the right frame rate.
    smooth_option : the one that leaves noise out.
    """
    falls = fall_warning(motion, pieces, f"{rate_option} says the right one")
    found = (
        lead_in_notice(motion),
        cut_warning(motion.source, pieces, motion.fps),
        falls,
        pop_warning(motion, pieces),
        # At a wrong rate everything trembles; what `auto` leaves is motion.
        ""
        if falls or motion.smooth_hz == "auto"
        else tremor_warning(motion, pieces, smooth_option),
    )
    return [warning for warning in found if warning]
