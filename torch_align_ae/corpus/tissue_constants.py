"""What synthetic flesh is made of: the one table of its constants, with their sources.

docs/data.md shows it; `tests/torch_align_ae/corpus/test_tissue_constants.py` holds the page to it.
"""

from __future__ import annotations

from typing import NamedTuple


class Flesh(NamedTuple):
    """Flesh of one part of the body."""

    frequency_hz: float
    """Of a small vertical vibration on a person who stands, apart from its neighbours."""
    depth_m: float
    """Depth of flesh over the bone at which it has that frequency."""
    damping_ratio: float
    """Of that vibration."""
    preload: float
    """Sag over that of a linear spring of that frequency: 2 swings half as fast without weight."""
    source: str


WAKELING = "leg tissue 10 to 65 Hz (Wakeling and Nigg 2001)"
NONE = "none known; as flesh elsewhere"
FLESH = {
    "chest": Flesh(3.15, 0.050, 0.215, 2.0, "damping 0.215, strongest at 4 Hz (Chen, Ng, Yu 2013)"),
    "belly": Flesh(4.5, 0.060, 0.22, 2.0, NONE),
    "back": Flesh(6.0, 0.040, 0.22, 2.0, NONE),
    "buttocks": Flesh(4.5, 0.050, 0.22, 2.0, NONE),
    "upper_arms": Flesh(7.0, 0.025, 0.22, 2.0, NONE),
    "forearms": Flesh(10.0, 0.015, 0.22, 2.0, NONE),
    "thighs": Flesh(8.0, 0.070, 0.30, 2.0, "rings at 10 to 11 Hz after a landing (Cereatti 2017)"),
    "calves": Flesh(10.0, 0.045, 0.30, 2.0, WAKELING),
}
"""By part of the body (`bridge.body.parts`); of what is not named the skin lies on bone."""
MENS_FLESH = {
    "chest": Flesh(
        4.0, 0.050, 0.22, 2.0, "markers on a man's kick: half as far as at 4 Hz in place"
    )
}
"""Where men's differs: muscle."""
WAVE_SPEED_M_S = 0.4
FIRMEST_HZ = 20.0
