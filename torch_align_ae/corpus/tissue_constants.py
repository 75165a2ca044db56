"""What synthetic flesh is made of: the one table of its constants, with their sources.

docs/data.md shows it; `tests/torch_align_ae/corpus/test_tissue_parameters.py` holds the page to it.
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
    source: str


NONE = "not measured; damping as elsewhere"
FLESH = {
    "chest": Flesh(3.3, 0.050, 0.215, "breast: damping 0.215, most at 4 Hz (Chen, Ng, Yu 2013)"),
    "belly": Flesh(5.5, 0.060, 0.22, "unknown; viscera 50 to 80 mm in hops (Minetti, Belli 1994)"),
    "back": Flesh(6.0, 0.040, 0.22, NONE),
    "buttocks": Flesh(5.5, 0.050, 0.22, NONE),
    "upper_arms": Flesh(7.0, 0.025, 0.22, NONE),
    "forearms": Flesh(10.0, 0.015, 0.22, NONE),
    "thighs": Flesh(8.0, 0.070, 0.30, "rings at 10 to 11 Hz after a hop (Cereatti's bone pins)"),
    "calves": Flesh(10.0, 0.045, 0.30, "10 to 65 Hz (Wakeling 2001)"),
}
"""By part of the body (`bridge.body.parts`); of what is not named the skin lies on bone."""
MENS_FLESH = {
    "chest": Flesh(4.0, 0.050, 0.22, "muscle: half as far as before, by markers on a man's kick"),
}
"""Where men's differs."""
PRELOAD = 2.0
"""Sag of standing flesh over that of linear springs; 2: without weight it swings half as fast. From
markers on a jumping woman; her law's stiffening about the standing shape has the wrong sign."""
WAVE_SPEED_M_S = 0.4
"""That couples skin with its neighbours; markers say 0.3 to 0.6, and trade it with frequency."""
FIRMEST_HZ = 20.0
"""Of thin flesh, beside bone."""
