"""How far two engines may differ, and why that far and no farther.

Every tolerance is relative to the scale of the reference's tensor: rounding errors are made by the
large terms of a sum and carried to the small results beside them. As a rule the largest difference
counts, against the largest number.

Gradients in float32, and the steps that follow from them, are the exception: there root mean
squares are compared. A gradient jumps where a nonlinearity has a kink, and Adam's first step where
a gradient is zero. Among the hundred thousands of numbers in a trained network some lie within
float32's rounding of either, and there two correct engines differ by what has nothing to do with
rounding. Such numbers are few and hardly move the root mean square; a mistake does: even a single
wrong number among a hundred thousand weighs three thousandths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bridge.verify.protocol import DTypeName


@dataclass(frozen=True)
class Tolerance:
    """A limit and its reason."""

    limit: float
    """Largest difference, relative to the tensor's scale."""
    reason: str
    """Why a correct engine stays below it, and a wrong one does not."""
    norm: Literal["max", "rms"] = "max"
    """What is compared: the largest numbers, or root mean squares."""


EXACT = Tolerance(0.0, "weights are moved and not computed, so every bit comes back")
FLOAT64 = Tolerance(
    1e-10,
    "2^-53 is 1.1e-16; sums of 6890 terms, 1000 steps of a recurrence or ten of Adam leave five "
    "digits to spare, and the smallest classical mistake (Adam's epsilon) is above it",
)
FLOAT32_FORWARD = Tolerance(
    1e-5,
    "2^-24 is 6e-8, times the square root of the longest sum (6890 terms: 83) is 5e-6",
)
FLOAT32_GRADIENT = Tolerance(
    1e-3,
    "a gradient sums over frames and vertices what a forward pass has already rounded, and its "
    "terms cancel: one digit more than forwards; and one more, of root mean squares, for the few "
    "numbers that stand at a kink",
    "rms",
)
FORWARD_PARTS = ("layers", "loss", "losses")


def tolerance_of(part: str, dtype: DTypeName) -> Tolerance:
    """The limit for one part of a check's results."""
    if part == "files":
        return EXACT
    if dtype == "float64":
        return FLOAT64
    return FLOAT32_FORWARD if part in FORWARD_PARTS else FLOAT32_GRADIENT
