"""What crosses between the frameworks: NumPy arrays in files, weights and their layouts.

The artifacts and motions that stages exchange live in `bridge.runs` and `bridge.motion`; the three
functions that a user of the files needs are given here too.
"""

from bridge.exchange.weights import load_weights, save_weights
from bridge.motion import load_amass_motion
from bridge.runs import read_artifact, write_artifact

__all__ = [
    "load_amass_motion",
    "load_weights",
    "read_artifact",
    "save_weights",
    "write_artifact",
]
