"""The synthetic subjects of the corpus, which share only their names with Dyna's subjects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bridge.body.model_data import SHAPE_COUNT

Gender = Literal["female", "male"]


@dataclass(frozen=True)
class Subject:
    """One body."""

    name: str  # as in `<subject>_<motion>`
    shape: tuple[float, ...]  # first coefficients in the embedded shape space; the rest are zero

    @property
    def betas(self) -> NDArray[np.float64]:
        """(10,) shape coefficients, as exact in float32 as they are stored."""
        betas = np.zeros(SHAPE_COUNT, np.float32)
        betas[: len(self.shape)] = self.shape
        return betas.astype(np.float64)


# From the heaviest to the leanest, except for the second and third women and men.
SUBJECTS: dict[Gender, tuple[Subject, ...]] = {
    "female": (
        Subject("50004", (0.4, 1.9, 1.7, 0.5, 0.6, -0.4)),
        Subject("50020", (-1.0, 0.8, 1.0, -0.6, -0.5, 0.8)),
        Subject("50021", (1.1, -0.2, 0.2, 0.7, 0.3, 0.5)),
        Subject("50022", (-0.3, -1.1, -0.6, -0.8, 0.7, -0.6)),
        Subject("50025", (0.1, -1.7, -1.5, 0.4, -0.9, 0.3)),
    ),
    "male": (
        Subject("50002", (0.5, 1.8, -0.6, 0.9, -0.8, 0.2)),
        Subject("50007", (-0.9, 1.0, 0.4, 0.4, -0.5, -0.6)),
        Subject("50009", (1.0, 0.1, -0.5, -0.3, 0.4, 0.6)),
        Subject("50026", (-0.2, -0.8, 0.7, -0.5, 0.3, -0.3)),
        Subject("50027", (0.2, -1.6, 0.3, -0.8, 0.6, 0.5)),
    ),
}
# Used by no stage before prediction: one of middle weight, one heavier, one lean.
UNSEEN: dict[Gender, tuple[Subject, ...]] = {
    "female": (
        Subject("99001", (-0.5, 1.3, 0.3, -0.2, 0.8, -0.9)),
        Subject("99003", (0.7, 1.7, 1.3, -0.7, -0.3, 0.6)),
        Subject("99005", (-0.5, -1.3, -1.0, 0.6, 0.2, -0.5)),
    ),
    "male": (
        Subject("99002", (-0.5, 1.2, 0.3, -0.2, 0.8, -0.9)),
        Subject("99004", (0.8, 1.6, -0.2, 0.6, 0.5, -0.4)),
        Subject("99006", (-0.6, -1.3, 0.5, 0.3, -0.6, 0.4)),
    ),
}
