"""The tissue laws by name: what a corpus may be made with."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from torch_align_ae.body import SMPL
from torch_align_ae.corpus.second_tissue_simulation import SecondTissueSimulator
from torch_align_ae.corpus.simulation import TissueSimulator
from torch_align_ae.corpus.third_tissue_simulation import ThirdTissueSimulator

TissueName = Literal["own", "second", "third"]


class Simulator(Protocol):
    """The soft tissue of one subject."""

    def offsets(self, theta: NDArray[np.floating], fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69)."""
        ...


def tissue_of(
    name: TissueName, smpl: SMPL, betas: NDArray[np.floating], *, gravity: bool = True
) -> Simulator:
    """The soft tissue of the subject with shape `betas` (10,) under a law of `TISSUES`."""
    return TISSUES[name](smpl, betas, gravity=gravity)


TISSUES: dict[
    TissueName,
    type[TissueSimulator] | type[SecondTissueSimulator] | type[ThirdTissueSimulator],
] = {
    "own": TissueSimulator,
    "second": SecondTissueSimulator,
    "third": ThirdTissueSimulator,
}
