"""Laws of soft tissue and forms of meshes that a corpus can be made with, by name.

To add a law, write a `TissueLaw` and register it here or in the function `tissues()` of a module
that `DSNET_PLUGINS` names (`bridge/plugins.py`); forms are registered in `mesh_forms()`. Laws for
testing predictors are outside of the product, so that nothing in it is adapted to them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.body import BodyModelData
from bridge.plugins import entry_named, with_plugins
from dsnet.synthetic.simulation import TissueSimulator


class MovedTissue(Protocol):
    """The soft tissue of one subject."""

    def offsets(self, theta: NDArray[np.floating], fps: float) -> NDArray[np.float32]:
        """Offsets (T, V, 3) in the rest pose, metres, of a motion (T, 69)."""
        ...


class TissueLaw(Protocol):
    """Makes the soft tissue of a subject from a body model and betas (10,)."""

    def __call__(
        self, body: BodyModelData, betas: NDArray[np.floating], /, *, gravity: bool
    ) -> MovedTissue: ...


class MeshForm(Protocol):
    """Differences of a corpus's meshes from SMPL other than soft tissue."""

    def static(self, subject: str, theta: NDArray[np.floating]) -> NDArray[np.float32]:
        """Static offsets (T, V, 3) in the rest pose, metres, in poses (T, 69)."""
        ...

    def registered(self, sequence: str, meshes: NDArray, fps: float) -> NDArray:
        """Meshes (T, V, 3), metres, with errors of registration, which the truth has not."""
        ...


MakeForm = Callable[[BodyModelData, int], MeshForm]
"""Makes a form from a body model and the corpus's seed."""


def tissue_named(name: str) -> TissueLaw:
    """The law of soft tissue with this name."""
    builtin: dict[str, TissueLaw] = {"own": TissueSimulator}
    return entry_named(name, "--tissue", with_plugins("tissues", builtin))


def form_named(name: str) -> MakeForm | None:
    """The form of meshes with this name; None for clean ones, without further differences."""
    builtin: dict[str, MakeForm | None] = {"clean": None}
    return entry_named(name, "--form", with_plugins("mesh_forms", builtin))
