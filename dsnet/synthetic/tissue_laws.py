"""What a corpus may be made with, by name: laws of soft tissue, and forms of its meshes.

A new law is a file with what `TissueLaw` says, and a line: here, or in the function `tissues()` of
a module that `DSNET_PLUGINS` names (`bridge/plugins.py`); so is a form, in `mesh_forms()`. Laws to
test predictors on stand outside of the product, so that nothing in it is made for them.
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
    """Gives the tissue of a subject: of a body model and a shape (10,)."""

    def __call__(
        self, body: BodyModelData, betas: NDArray[np.floating], /, *, gravity: bool
    ) -> MovedTissue: ...


class MeshForm(Protocol):
    """What the meshes of a corpus have besides soft tissue."""

    def static(self, subject: str, theta: NDArray[np.floating]) -> NDArray[np.float32]:
        """What does not move: offsets (T, V, 3) in the rest pose, metres, in poses (T, 69)."""
        ...

    def registered(self, sequence: str, meshes: NDArray, fps: float) -> NDArray:
        """Meshes (T, V, 3), metres, as files have them; what differs is no part of the truth."""
        ...


MakeForm = Callable[[BodyModelData, int], MeshForm]
"""Of a body model and the corpus's seed."""


def tissue_named(name: str) -> TissueLaw:
    """The law of a name."""
    own: dict[str, TissueLaw] = {"own": TissueSimulator}
    return entry_named(name, "--tissue", with_plugins("tissues", own))


def form_named(name: str) -> MakeForm | None:
    """The form of a name; None for clean meshes, which have nothing besides."""
    own: dict[str, MakeForm | None] = {"clean": None}
    return entry_named(name, "--form", with_plugins("mesh_forms", own))
