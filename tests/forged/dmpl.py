"""DMPL's file of directions, forged: its own is licensed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def forged_directions(count: int = 8) -> NDArray[np.float64]:
    """(6890, 3, count), neither of length 1 nor at right angles."""
    return 1e-3 * np.random.default_rng(4).normal(size=(6890, 3, count)).cumsum(axis=2)


def save_dmpl(path: Path, count: int = 8) -> Path:
    """As `dmpls/<gender>/model.npz`, with a field that nobody reads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, eigvec=forged_directions(count), eigval=np.arange(count)[::-1] + 1.0)
    return path
