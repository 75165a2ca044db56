"""How far two engines may differ, and why that far and no farther.

Every tolerance is relative to the largest number of the reference's tensor: rounding errors are
made by the large terms of a sum and carried to the small results beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

from bridge.verify.protocol import DTypeName


@dataclass(frozen=True)
class Tolerance:
    """A limit and its reason."""

    limit: float
    """Largest difference, relative to the tensor's scale."""
    reason: str
    """Why a correct engine stays below it, and a wrong one does not."""


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
    1e-4,
    "a gradient sums over frames and vertices what a forward pass has already rounded, and its "
    "terms cancel: one digit more than forwards",
)
FORWARD_PARTS = ("layers", "loss", "losses")


def tolerance_of(part: str, dtype: DTypeName) -> Tolerance:
    """The limit for one part of a check's results."""
    if part == "files":
        return EXACT
    if dtype == "float64":
        return FLOAT64
    return FLOAT32_FORWARD if part in FORWARD_PARTS else FLOAT32_GRADIENT
